"""Finds the errors of a ribbon's sensors from its RAW readings."""
