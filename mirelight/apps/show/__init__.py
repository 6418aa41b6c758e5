"""Frames shown to people: contact sheets and films of what a folder holds."""
