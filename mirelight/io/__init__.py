"""Readers and writers, one module per format. Nothing here knows Mitsuba or Dr.Jit."""
