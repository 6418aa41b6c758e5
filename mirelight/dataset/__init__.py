"""Data sets: frames in the layouts that loaders of neural renderers read."""
