"""Hardware in the loop: emulated ribbons, and checks for emulated and real ones."""
