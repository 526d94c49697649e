"""Who may see the page: a token in the URL, and checks of what a browser says about where a request comes from.

On this machine alone (the default) no token is needed. What must be kept out there are other pages in the user's own
browser, which may send requests to localhost: their `Origin` differs, or, where they have pointed a name of their own
at 127.0.0.1 (DNS rebinding), their `Host`. Reachable from elsewhere, a random token is the first part of the path, so
that page and websocket, whose address the page derives from its own, both carry it.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

from destello.errors import InputError

_LOCAL_NAMES = ("localhost", "localhost.localdomain", "ip6-localhost")
_TOKEN_BYTES = 18  # 144 bits
_LEAST_TOKEN = 16  # characters of a token that a user chooses


def is_local(host: str) -> bool:
    """Whether nothing but this machine can reach a server that is bound to `host`."""
    if host.lower() in _LOCAL_NAMES:
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a request is turned away: HTTP status and one line."""

    status: int
    reason: str


@dataclass(frozen=True, slots=True)
class Access:
    """The rule for one server. `token`: the first part of every path; None: only this machine, and no token."""

    token: str | None = None

    @classmethod
    def for_host(cls, host: str, token: str | None = None) -> Access:
        """A token is made for a host that others can reach. Raises InputError for a token that is easily guessed."""
        if token is None:
            return cls(None if is_local(host) else secrets.token_urlsafe(_TOKEN_BYTES))
        if len(token) < _LEAST_TOKEN or not all(c.isascii() and (c.isalnum() or c in "-_") for c in token):
            expected = f"at least {_LEAST_TOKEN} letters, digits, - and _"
            raise InputError("not a safe token", place="token", expected=expected)
        return cls(token)

    @property
    def prefix(self) -> str:
        """What every path begins with: `/` or `/TOKEN/`."""
        return "/" if self.token is None else f"/{self.token}/"

    def check(self, target: str, hosts: Sequence[str], origins: Sequence[str]) -> str | Refusal:
        """The path that is meant, without the token, or why the request is refused.

        Args:
            target: the request's path with its query, as sent.
            hosts: the values of the Host header.
            origins: those of the Origin header.
        """
        path = target.partition("?")[0]
        if self.token is not None:
            first, _, rest = path.removeprefix("/").partition("/")
            if not hmac.compare_digest(first.encode(), self.token.encode()):
                return Refusal(403, "wrong or missing token: use the whole address that destello printed")
            path = "/" + rest
        if len(hosts) != 1 or len(origins) > 1:
            return Refusal(400, "one Host header, and at most one Origin, are needed")
        if self.token is None and not is_local(_host_of(hosts[0])):
            return Refusal(403, "this server answers on this machine only; --host and its token open it to others")
        if origins and urlsplit(origins[0]).netloc.lower() != hosts[0].lower():
            return Refusal(403, "the request comes from another site's page")
        return path


def _host_of(netloc: str) -> str:
    """`[::1]:80` to `::1`; what cannot be read gives an empty text."""
    try:
        return urlsplit("//" + netloc).hostname or ""
    except ValueError:
        return ""


def address(host: str, port: int, access: Access) -> str:
    """The URL to open: for a server on all interfaces, with this machine's name."""
    if host in ("0.0.0.0", "::", ""):
        import socket

        host = socket.gethostname()
    shown = f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}{access.prefix}"
