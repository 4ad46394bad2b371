"""Source models: trained sources in MLflow's Model Registry, and registered ones as pretrained sources."""
