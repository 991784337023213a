"""The robot: what the laboratory builds, simulates, measures and improves."""
