"""The ground floor: signals with units and time, recordings in and out, imports, tables."""
