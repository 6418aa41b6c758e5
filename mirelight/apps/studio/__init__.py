"""The studio: a page that takes a capture from its file to relit frames, lights and cameras set by looking."""

from mirelight.apps.studio.document import Document, opened

__all__ = ["Document", "opened"]
