#!/bin/bash
# A halflight animation as a SLURM job array: every task renders CHUNK frames of one list, and the same files may be asked
# for again: those that are whole are kept.
#   sbatch --array=0-4 farm/slurm_array.sh turn.toml 'out/f.####.exr' 1 24
# With a field that no frame changes, compute it once before (FIELD=field.nrrd names it to the frames):
#   job=$(sbatch --parsable --wrap "halflight precompute turn.toml -o field.nrrd")
#   FIELD=field.nrrd sbatch --dependency=afterok:$job --array=0-4 farm/slurm_array.sh turn.toml 'out/f.####.exr' 1 24
# Where frames change their fields, FIELDS=folder (on a disk that all nodes see) has each field computed once.
#SBATCH --job-name=halflight
#SBATCH --cpus-per-task=8
#SBATCH --signal=B:TERM@60
#SBATCH --requeue
set -u
scene=$1 output=$2 first=$3 last=$4
chunk=${CHUNK:-5}
from=$((first + SLURM_ARRAY_TASK_ID * chunk))
to=$((from + chunk - 1))
[ "$to" -le "$last" ] || to=$last
[ "$from" -le "$last" ] || exit 0
child= code=143
trap 'stopped=1; kill -TERM "$child" 2>/dev/null' TERM
for try in $(seq "${TRIES:-3}"); do
  [ -z "${stopped:-}" ] || break
  "${HALFLIGHT:-halflight}" frames "$scene" -o "$output" --frames "$from-$to" --skip-existing --progress lines \
    --threads "${SLURM_CPUS_PER_TASK:-1}" ${FIELD:+--field "$FIELD"} ${FIELDS:+--fields "$FIELDS"} &
  child=$!
  wait "$child"
  code=$?
  # A trapped signal ends the first wait early.
  [ "$code" -gt 128 ] && { wait "$child"; code=$?; }
  # 6: the device was lost; another try may have it back. 143: out of time, requeued frames go on.
  [ "$code" -eq 6 ] || break
  echo "the device was lost, try $try" >&2
done
if [ "$code" -eq 143 ] && [ -n "${SLURM_JOB_ID:-}" ]; then scontrol requeue "$SLURM_JOB_ID"; fi
exit "$code"
