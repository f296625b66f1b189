"""Runs a script beside a Ray cluster of two nodes with a core each on this machine: the script, then its arguments."""

import os
import subprocess
import sys

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"

from ray.cluster_utils import Cluster  # noqa: E402

# Enough for the program and the shards; the default is a share of the machine's memory.
NODE = {"num_cpus": 1, "object_store_memory": 100 << 20}

cluster = Cluster(initialize_head=True, head_node_args={**NODE, "include_dashboard": False})
try:
    cluster.add_node(**NODE)
    cluster.wait_for_nodes()
    script, *arguments = sys.argv[1:]
    code = subprocess.run([sys.executable, script, "--address", cluster.address, *arguments]).returncode
finally:
    cluster.shutdown()
sys.exit(code)
