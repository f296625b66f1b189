"""Flies a suite on a Ray cluster: shards are mapped over the nodes and merged to what one machine prints.

    python3 examples/ray_suite.py suite.json --shards 64                    # this machine alone
    python3 examples/ray_suite.py suite.json --shards 64 --address auto     # the cluster of `ray start`
    python3 examples/ray_suite.py suite.json -- --snr-db 20 --seed 3        # what `foxhound suite` is given as well

The suite and the program go to the nodes through Ray, so nothing but Ray has to be installed there; the nodes must be of
one kind. A shard takes one core. A shard whose worker or node is lost is flown again, and comes to the same bytes.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import ray


@ray.remote(num_cpus=1, max_retries=3)
def fly(program, suite, shard, options):
    """One shard: the name of its file, its bytes, and the node."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        binary, file = place / "foxhound", place / "suite.json"
        binary.write_bytes(program)
        binary.chmod(0o700)
        file.write_bytes(suite)
        command = [binary, "suite", file, "--json", "--jobs", "1", "--shard", shard, "--out", place, *options]
        flown = subprocess.run(command, capture_output=True)
        # 1 says that a beacon was not reached, which is a result.
        if flown.returncode not in (0, 1):
            raise RuntimeError(flown.stderr.decode())
        (written,) = place.glob("shard-*.jsonl")
        return written.name, written.read_bytes(), ray.get_runtime_context().get_node_id()


def arguments():
    """Ours, and behind `--` those of `foxhound suite`."""
    ours, options = sys.argv[1:], []
    if "--" in ours:
        at = ours.index("--")
        ours, options = ours[:at], ours[at + 1 :]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suite", type=Path, help="suite file, as `foxhound maps` writes it")
    parser.add_argument("--shards", type=int, help="parts [default: four a core]")
    parser.add_argument("--address", help="the cluster [default: one of this machine's cores]")
    parser.add_argument("--foxhound", type=Path, default=Path("target/release/foxhound"), help="the program")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder of the shards")
    return parser.parse_args(ours), options


def main():
    args, options = arguments()
    program, suite = args.foxhound.read_bytes(), args.suite.read_bytes()
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # Ray prints there that a worker died; standard output is for the result, which `foxhound merge` writes.
    sys.stdout = sys.stderr
    ray.init(address=args.address, log_to_driver=False, include_dashboard=None if args.address else False)
    # Put once, not once a shard.
    program, suite = ray.put(program), ray.put(suite)
    shards = args.shards or max(1, 4 * int(ray.cluster_resources().get("CPU", 1)))
    waiting = [fly.remote(program, suite, f"{k}/{shards}", options) for k in range(1, shards + 1)]

    args.out.mkdir(parents=True, exist_ok=True)
    files, nodes = [], set()
    while waiting:
        (done,), waiting = ray.wait(waiting)
        name, flown, node = ray.get(done)
        (args.out / name).write_bytes(flown)
        files.append(args.out / name)
        nodes.add(node)
        print(f"{len(files)} of {shards} shards", end="\r", file=sys.stderr)
    print(f"{shards} shards on {len(nodes)} nodes", file=sys.stderr)
    return subprocess.run([args.foxhound, "merge", "--json", *files]).returncode


if __name__ == "__main__":
    sys.exit(main())
