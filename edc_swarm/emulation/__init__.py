"""The emulated world around an agent: network links, GPS receivers, energy.

This package decides how links delay and drop messages, which position a receiver measures and how much energy a flight
takes. It imports `mission` and `errors`, never a message type. Open `links` first.
"""
