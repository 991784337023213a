"""The laboratory: scenes, replay, reports, views and the command line."""
