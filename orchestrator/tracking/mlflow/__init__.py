"""MLflow as a tracker: the browsing copy of a sweep."""
