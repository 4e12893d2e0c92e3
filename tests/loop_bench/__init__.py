"""The bench of close-loop: how often simulated shop days are diagnosed right, against its bar.

python -m loop_bench [--tuning] prints the table; LOOP_SCALE=0.1 draws a tenth of the data sets.
What was drawn is kept in pieces, so that a run that was stopped goes on where it was.
"""

from __future__ import annotations
