"""Runs a script beside a Ray cluster of two nodes with a core each on this machine: the script, then its arguments.

With `--kill` before the script, the process of a worker is ended by SIGKILL, with the flight that it has begun, as soon as
both nodes fly.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"

from ray.cluster_utils import Cluster  # noqa: E402

# Enough for the program and the shards; the default is a share of the machine's memory.
NODE = {"num_cpus": 1, "object_store_memory": 100 << 20}


def parents():
    """Processes that fly a shard of this cluster, and their parents: the workers. The program is in `$TMPDIR`."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            command = (folder / "cmdline").read_bytes().split(b"\0")
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
        except (OSError, IndexError):
            continue  # It has ended meanwhile.
        if b"--shard" in command and os.fsencode(os.environ["TMPDIR"]) in command[0]:
            found[int(folder.name)] = parent
    return found


def kill_worker(running):
    """Ends the first worker that flies, held until the other node flies too; whether both did."""
    held, until = None, time.monotonic() + 120
    while running.poll() is None and time.monotonic() < until:
        for flight, worker in parents().items():
            with contextlib.suppress(ProcessLookupError):
                if held is None:
                    # Stopped, it cannot end before its worker does, and the other node must fly what waits.
                    os.kill(flight, signal.SIGSTOP)
                    held = worker, flight
                elif worker != held[0]:
                    for process in held:
                        os.kill(process, signal.SIGKILL)
                    print(f"worker {held[0]} was killed", file=sys.stderr)
                    return True
        time.sleep(0.002)
    for process in [running.pid, *(held or ())]:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
    return False


arguments = sys.argv[1:]
kill = arguments[0] == "--kill"
cluster = Cluster(initialize_head=True, head_node_args={**NODE, "include_dashboard": False})
try:
    cluster.add_node(**NODE)
    cluster.wait_for_nodes()
    script, *options = arguments[kill:]
    running = subprocess.Popen([sys.executable, script, "--address", cluster.address, *options])
    if kill and not kill_worker(running):
        sys.exit("not both nodes flew")
    code = running.wait()
finally:
    cluster.shutdown()
sys.exit(code)
