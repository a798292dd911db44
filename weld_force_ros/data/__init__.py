"""Tracks, fits, profiles and limits that are shipped, each with its sources."""
