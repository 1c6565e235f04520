"""A UAV process that says on its standard error the key of each query for liveliness tokens that it makes."""

from __future__ import annotations

import sys
from typing import Any

import zenoh

from processes.bus.subscriptions import UavSubscriptions
from processes.uav.process import main


class Told:
    """A session, or its liveliness, whose liveliness subscriptions are told."""

    def __init__(self, inner: Any) -> None:
        self._inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def liveliness(self) -> Told:
        """Return the liveliness of the session."""
        return Told(self._inner.liveliness())

    def declare_subscriber(self, key: str, take: Any, **options: Any) -> Any:
        """Declare a subscriber; with a history it queries the router."""
        if options.get("history"):
            print(key, file=sys.stderr, flush=True)
        return self._inner.declare_subscriber(key, take, **options)


if __name__ == "__main__":
    begun = UavSubscriptions.__init__

    def begin(self: UavSubscriptions, session: zenoh.Session, *rest: object) -> None:
        """Begin with a session that tells."""
        begun(self, Told(session), *rest)  # type: ignore[arg-type]

    UavSubscriptions.__init__ = begin  # type: ignore[method-assign,assignment]
    main()
