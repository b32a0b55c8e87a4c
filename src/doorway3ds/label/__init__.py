"""Pictures marked by hand on a local page: `doorways.csv` and a folder per class."""
