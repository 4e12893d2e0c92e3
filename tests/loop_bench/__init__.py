"""The bench of close-loop: how often simulated sets are diagnosed right by the command itself.

python -m loop_bench OUT.jsonl [--judging]     draws what is missing in the file, prints the table
python -m loop_bench.compare OLD NEW           two runs of the same sets, paired

`records.jsonl.gz` beside this file is what 61d6796 says of the sets of tuning days;
`judging.jsonl.gz` those of judging days behind the table in `mtu help accuracy`, which unpacked
can be gone on with as long as the package is the same. Any tree that is installed in some
environment can be judged: PYTHONPATH=tests, and that environment's python.
"""

import os

# As in the command, before anything imports numpy.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
