"""Which source network advises, settled once the sources are trained."""
