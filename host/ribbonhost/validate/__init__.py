"""Compares reconstructed positions with those of an optical system (the paper's section 4.1)."""
