"""From devices to a moving surface: the one room that knows devices and reconstruction."""
