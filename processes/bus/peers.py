"""UAVs on the bus, by liveliness tokens: a hint to the election, never proof."""

from __future__ import annotations

from processes.bus.subscriptions import MAX_TOKENS, Token

CHECK_AFTER_NS = 30_000_000
"""Wait before a vanished token counts: all tokens vanish if the router goes."""


class Peers:
    """Instances of every UAV by their liveliness tokens, and the UAVs that are gone."""

    def __init__(self) -> None:
        self._alive: dict[str, set[str]] = {}
        self._tokens = 0
        self._checks: dict[str, int] = {}

    def take(self, token: Token, now_ns: int) -> None:
        """Take in a token's change; a UAV without instances is due for a check after `CHECK_AFTER_NS`."""
        if token.alive:
            self._remember(token)
            return
        instances = self._alive.get(token.uav, set())
        self._tokens -= token.instance in instances
        instances.discard(token.instance)
        if not instances:
            self._alive.pop(token.uav, None)
            self._checks.setdefault(token.uav, now_ns + CHECK_AFTER_NS)

    def _remember(self, token: Token) -> None:
        self._checks.pop(token.uav, None)
        instances = self._alive.get(token.uav, set())
        if self._tokens < MAX_TOKENS and token.instance not in instances:
            self._alive[token.uav] = instances | {token.instance}
            self._tokens += 1

    @property
    def next_ns(self) -> int | None:
        """Time of the next check, None if there is none."""
        return min(self._checks.values(), default=None)

    def gone(self, now_ns: int) -> list[str]:
        """Return the UAVs whose check is due and that have not come back."""
        due = [uav for uav, when_ns in self._checks.items() if when_ns <= now_ns]
        for uav in due:
            del self._checks[uav]
        return due
