"""Simulated instruments for any program, on the wires of real ones.

`world.World` is what instruments look at; whoever has a device of his own implements it. `instruments` and
`rate_tables` speak the command sets of their models. `wires` brings them to PyVISA and pyserial in this process,
`serve` to sockets, VXI-11, HiSLIP and serial lines.
"""
