"""The emulated world around an agent: network links, GPS receivers, energy.

This package decides what the network does to a message, what a receiver measures and what a flight costs. It imports
`mission` and `errors`, never a message type. Open `links` first.
"""
