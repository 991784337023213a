"""The thesis regenerated: its tables, numbers and figures, chapter by chapter."""
