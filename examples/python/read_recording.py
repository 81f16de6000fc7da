"""Reads a recording: what went wrong, and the largest following error of each axis. ``python3 read_recording.py FILE``"""

import sys

import numpy as np

import ecmsk

run = ecmsk.recording(sys.argv[1])
print(f"{run.frame_count} frames in {run.duration:.3f} s")
for line in run.summary or ["nothing went wrong"]:
    print(line)
for slave in run.slaves:
    axis = run.axis(slave)
    error = np.abs(axis.following_error)
    if np.isnan(error).all():
        print(f"axis {slave}: no target was executed")
        continue
    at = int(np.nanargmax(error))
    print(f"axis {slave}: following error up to {error[at]:.0f} counts, after {axis.time[at]:.3f} s")
