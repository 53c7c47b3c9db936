"""Brings the MicroPython of hil/probe to a board, or to an emulated one."""
