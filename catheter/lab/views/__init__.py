"""Dashboards. The only modules of the project that import rerun."""
