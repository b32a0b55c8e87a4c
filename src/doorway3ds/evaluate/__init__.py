"""Metrics with intervals, readers of marked data sets, and reports.

`direction.score(records)`, `classifier.score(records)` and `depth.score(records)` are pure;
training code calls them without the command line.
"""
