"""Runs the checks of hil/checks on any ribbon: the firmware as a module, the image, or hardware."""
