"""A job watched while it is edited: what a saved change touches is shown at once, and then rendered."""
