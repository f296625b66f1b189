"""Runs a script beside a Ray cluster of two nodes with a core each on this machine: the script, then its arguments.

With `--kill` before the script, the process of a worker is ended by SIGKILL, with the flight that it has begun, when
both nodes fly, and both fly again before the next shard is done.
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


def status(process):
    """State and parent of a process; nothing where it has ended."""
    try:
        state, parent = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[:2]
        return state, int(parent)
    except OSError:
        return None, None


def flights():
    """Processes that fly a shard of this cluster, each with its worker and its node's raylet. The program is in `$TMPDIR`."""
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            command = (folder / "cmdline").read_bytes().split(b"\0")
            if b"--shard" in command and os.fsencode(os.environ["TMPDIR"]) in command[0]:
                worker = status(folder.name)[1]
                node = worker and status(worker)[1]
                if node:
                    yield int(folder.name), worker, node


def send(processes, number):
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, number)


def hold(running, other_than=None):
    """Stops a flight, of another node than one if that is given: it cannot end then. The flight, its worker and its node."""
    until = time.monotonic() + 600
    while running.poll() is None and time.monotonic() < until:
        for flight, worker, node in flights():
            if node != other_than:
                send([flight], signal.SIGSTOP)
                while status(flight)[0] not in (None, "T", "Z"):
                    time.sleep(0.001)
                if status(flight)[0] == "T":
                    return flight, worker, node
        time.sleep(0.002)
    send([running.pid], signal.SIGKILL)
    sys.exit("not both nodes fly")


def kill_worker(running):
    """Ends a worker that flies while the other node flies too, and lets that go on once there is a new worker at work."""
    first, worker, node = hold(running)
    second, _, other = hold(running, node)
    send([worker, first], signal.SIGKILL)
    print(f"worker {worker} was killed", file=sys.stderr)
    third, _, _ = hold(running, other)
    send([second, third], signal.SIGCONT)


arguments = sys.argv[1:]
kill = arguments[0] == "--kill"
cluster = Cluster(initialize_head=True, head_node_args={**NODE, "include_dashboard": False})
try:
    cluster.add_node(**NODE)
    cluster.wait_for_nodes(timeout=300)
    script, *options = arguments[kill:]
    running = subprocess.Popen([sys.executable, script, "--address", cluster.address, *options])
    if kill:
        kill_worker(running)
    code = running.wait()
finally:
    send([flight for flight, _, _ in flights()], signal.SIGKILL)
    cluster.shutdown()
sys.exit(code)
