"""Shipped files, damaged at random, through every reader and every command.

``make fuzz`` or ``python -m fuzz --readers N --commands M --seed S``. Every damaged file must be
read, or be refused with a clean message; every call of a command on one must end with code 0, 2
or 3, with all of its outputs whole, or on code 2 with none. All draws follow from the seed and
the number of a case: ``--first 4711 --readers 1`` repeats reader case 4711 alone. What fails is
kept under ``out/fuzz/`` with the call that repeats it.
"""
