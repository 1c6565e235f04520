"""The protocol of the swarm: messages, which messages are admissible, claims on UAV ids, retransmission, completion.

This package decides what bytes mean and which messages the receivers reject; it performs no I/O. It imports `mission`,
`geometry` and `errors`. Open `messages` first, then `keys` (who publishes where) and `codec` (bytes).
"""
