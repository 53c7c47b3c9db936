"""Accuracy and speed, measured on this machine; needs no device."""
