"""EDC-UAV as software: a pure, deterministic library for centrally planned UAV swarms.

Nothing in this package opens a socket, starts a thread, reads a clock or draws from a global
random generator. `processes` puts the same classes on a real bus. Every package below says in its
`__init__` what it decides, what it may import and which file to open first. No `__init__` imports
anything, so a UAV process starts without numpy.

Reference: S. Ouahouah, J. Prados-Garzon, T. Taleb, C. Benzaid, "Energy and Delay aware Physical
Collision Avoidance in Unmanned Aerial Vehicles", IEEE GLOBECOM 2018,
doi 10.1109/GLOCOM.2018.8647223 ("the paper" in every docstring).
"""

__version__ = "0.1.0"
