"""What was typed for a target, taken apart."""

from urllib.parse import urlsplit

from ribbonhost.errors import UsageError

EXAMPLES = "ndjson, ws://127.0.0.1:8765, tcp://127.0.0.1:8766, osc://127.0.0.1:9000, lsl"


def split_target(target: str) -> tuple[str, str, int]:
    """Kind, host and port; host empty and port 0 where there is none. Raises UsageError."""
    if target in ("ndjson", "lsl"):
        return target, "", 0
    if target == "lsl://network":
        return "lsl", "network", 0
    try:
        parts = urlsplit(target)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if host and port is not None and parts.scheme in ("ws", "tcp", "osc") and not parts.path.strip("/"):
        return parts.scheme, host, port
    raise UsageError(f"--out {target} is none of what can be: {EXAMPLES}")
