"""Reads schema.toml and writes what follows from it; generate.py is its command line."""
