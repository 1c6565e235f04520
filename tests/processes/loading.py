"""A UAV process whose planner is never loaded: the threads that load it solve QPs until the process ends."""

from __future__ import annotations

from threading import Thread

from processes.uav import planner_loader
from processes.uav.process import main

THREADS = 4


def _load(*_: object) -> None:
    for _number in range(THREADS):
        Thread(target=_solve, daemon=True).start()


def _solve() -> None:
    import numpy as np  # noqa: PLC0415
    import osqp  # noqa: PLC0415
    from scipy import sparse  # noqa: PLC0415

    size = 300
    identity = sparse.identity(size, format="csc")
    while True:
        solver = osqp.OSQP()
        solver.setup(identity, -np.ones(size), identity, np.zeros(size), np.ones(size) / 2, verbose=False)
        solver.solve()


if __name__ == "__main__":
    vars(planner_loader)["_load"] = _load
    main()
