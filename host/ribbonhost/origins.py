"""Which pages in a browser may open a WebSocket of this program."""

import re

LOCAL_PAGE = re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?")
"""A browser says in Origin which page asks: none of the internet may listen to a person's movements."""

ALLOWED = (None, LOCAL_PAGE)
"""What websockets takes as `origins`; None: programs that are no browser say nothing."""
