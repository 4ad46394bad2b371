#!/usr/bin/env bash
# A sweep on Slurm: Ray's head on the first node, a worker on each other, the sweep on top.
#
#     STORAGE=/shared/results sbatch deploy/slurm.sh SPACE [OPTIONS OF deltatune sweep]
#
# STORAGE: a folder that every node sees, or a URL such as s3://bucket/path. VENV: the virtual environment, which every
# node sees too; default: .venv where sbatch was called. HEAD_IP: the first node's address, where it has several.
# When the time is nearly up the sweep stops in order, and the job queues again: the same command goes on.
#SBATCH --job-name=deltatune
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=16
#SBATCH --mem-per-cpu=2G
#SBATCH --exclusive
#SBATCH --time=24:00:00
#SBATCH --signal=B:USR1@120
#SBATCH --requeue
#SBATCH --no-kill
#SBATCH --open-mode=append
#SBATCH --output=deltatune-%j.log
set -euo pipefail

: "${STORAGE:?set STORAGE to a folder that every node sees}"
(($#)) || { echo "error: which search space? sbatch deploy/slurm.sh SPACE" >&2; exit 2; }
export PATH="${VENV:-$SLURM_SUBMIT_DIR/.venv}/bin:$PATH"
command -v deltatune >/dev/null || { echo "error: no deltatune in VENV, nor on PATH" >&2; exit 2; }

sweep="" out_of_time="" signalled=""

main() { [[ $BASHPID == "$$" ]]; } # a child that is told before it is a program runs the traps too: it just ends
finish() { # leave no Ray behind
  local try pids
  main || return 0
  trap '' USR1 TERM
  for ((try = 0; try < 300; try++)); do
    pids=$(jobs -pr)
    [[ -n $pids ]] || return 0
    ((try % 50)) || xargs kill <<<"$pids" 2>/dev/null || true
    sleep .2
  done
  xargs kill -KILL <<<"$pids" 2>/dev/null || true
}
requeue() {
  echo "out of time: the job queues again, and goes on from here"
  scontrol requeue "$SLURM_JOB_ID"
  exit 0
}
stop() { # the sweep in order: finished cells are kept, running ones go on from their last checkpoint
  signalled=yes
  kill -TERM "$sweep" 2>/dev/null || true
}
out_of_time() { # what --signal sends
  main || exit 143
  out_of_time=yes
  [[ -n $sweep ]] || requeue
  stop
}
cancelled() { # what scancel sends: never queue again
  main || exit 143
  [[ -n $sweep ]] || exit 143
  stop
}
trap finish EXIT
trap out_of_time USR1
trap cancelled TERM

# The user's token file keeps others away from the cluster; a home folder is the same on every node.
export RAY_AUTH_MODE=token
ray get-auth-token --generate >/dev/null

hosts=$(scontrol show hostnames "$SLURM_JOB_NODELIST")
mapfile -t nodes <<<"$hosts"
# A step for each node, so that the loss of one ends no other.
step=(srun --nodes=1 --ntasks=1 --cpus-per-task="$SLURM_CPUS_PER_TASK" --overlap)
start_ray() { # NODE OPTIONS...
  "${step[@]}" --nodelist="$1" ray start --block --num-cpus="$SLURM_CPUS_PER_TASK" \
    --temp-dir="/tmp/ray-$SLURM_JOB_ID" --disable-usage-stats "${@:2}" &
}

head_ip=${HEAD_IP:-$("${step[@]}" --nodelist="${nodes[0]}" hostname -I)}
address="${head_ip%% *}:${RAY_PORT:-6379}"
start_ray "${nodes[0]}" --head --node-ip-address="${address%:*}" --port="${address#*:}" --include-dashboard=false
for node in "${nodes[@]:1}"; do
  start_ray "$node" --address="$address"
done

# Wait for every node: what is checked when a sweep joins, such as who sees STORAGE, is checked on all.
python - "$address" "${#nodes[@]}" "${JOIN_SECONDS:-300}" <<'PY' &
import sys, time

import ray

address, nodes, seconds = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
end, there = time.monotonic() + seconds, 0
while there < nodes:
    if time.monotonic() > end:
        sys.exit(f"error: {there} of {nodes} nodes have joined Ray within {seconds:.0f} s")
    try:
        if not ray.is_initialized():
            ray.init(address=address, log_to_driver=False, logging_level="ERROR")
        there = sum(node["Alive"] for node in ray.nodes())
    except (ConnectionError, RuntimeError):
        ray.shutdown()
    time.sleep(1)
PY
wait $!

deltatune sweep "$@" --address "$address" --storage "$STORAGE" &
sweep=$!
code=0
wait "$sweep" || code=$?
while [[ -n $signalled ]]; do # a signal ended the wait, not the sweep
  signalled="" code=0
  wait "$sweep" || code=$?
done
if [[ -n $out_of_time ]] && ((code > 128)); then
  requeue
fi
((code == 0)) || exit "$code"
