"""The operator: mission message, registration of hosts, faults, takeover of a mission whose operator died.

This package decides what the operator publishes on the bus. It imports `services`, `bus` and `runtime`. Open
`bus_client` first.
"""
