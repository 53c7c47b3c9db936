"""Handlers of the emulator's URLs, for pyserial: append this package to serial.protocol_handler_packages."""
