"""Pictures and video: what a camera saw, as plain numbers with their uncertainty."""
