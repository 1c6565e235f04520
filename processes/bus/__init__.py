"""The Zenoh bus: sessions, addresses, credentials, subscriptions, publishing with retransmission, presence.

This package decides how bytes enter and leave a process. It imports `runtime`. Open `session` first.
"""
