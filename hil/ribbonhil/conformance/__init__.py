"""The protocol conformance suite: every rule of protocol/PROTOCOL.md as a named check against any link."""
