"""Bytes <-> checked contracts: the only floor that opens files.

Import the module that is needed (``mtu_cli.files.machine``, ``mtu_cli.files.readings``);
nothing is imported here, so that a command loads neither numpy nor pandas in vain.
"""
