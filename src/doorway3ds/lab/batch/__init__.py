"""Decisions for very many images, on this machine's cores or on a Ray cluster (extra `batch`)."""
