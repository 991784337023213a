"""Finite elements for pressurised, multi-material tubes."""
