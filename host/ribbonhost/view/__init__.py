"""The live view: ribbons and surface in a page on 127.0.0.1, for any number of browsers."""

from ribbonhost.view.view import View, has_display, open_browser

__all__ = ["View", "has_display", "open_browser"]
