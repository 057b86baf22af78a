#!/bin/sh
# Fuzzes one target until its process has used so many CPU-seconds (libFuzzer's own limit counts waiting, too), and adds a
# line to WORK/log.tsv: target, commit, CPU-seconds, executions, edges covered, peak MiB, how it ended.
#   fuzz/run.sh TARGET CPU_SECONDS [WORK]        WORK (default ./fuzz-work) keeps what is found, outside the tree at best
# Built before with: cargo +nightly fuzz build -s none      (another folder of the programs: BIN=...)
set -eu
here=$(cd "$(dirname "$0")" && pwd)
target=$1 seconds=$2 work=${3:-fuzz-work}
bin=${BIN:-$here/target/x86_64-unknown-linux-gnu/release}
commit=${COMMIT:-$(git -C "$here" rev-parse --short HEAD)}
mkdir -p "$work/corpus/$target" "$work/finds"
log=$work/$target.log
set -- -max_len=4096 -timeout=900 -report_slow_units=5 -rss_limit_mb=512 -print_final_stats=1 "-artifact_prefix=$work/finds/$target-"
[ -f "$here/dict/$target.dict" ] && set -- "$@" "-dict=$here/dict/$target.dict"
# Its own process group, so that it can be stopped and continued apart from this script.
setsid "$bin/$target" "$@" "$work/corpus/$target" "$here/corpus/$target" >"$log" 2>&1 &
pid=$!
echo "$pid" >"$work/$target.pid"
used=0 per_second=$(getconf CLK_TCK)
while [ "$used" -lt "$seconds" ] && stat=$(cat "/proc/$pid/stat" 2>/dev/null); do
    # Behind the program's name, which may hold anything: utime and stime are the 12th and 13th.
    used=$(echo "${stat##*) }" | awk -v hz="$per_second" '{ print int(($12 + $13) / hz) }')
    sleep 2
done
kill -USR1 "$pid" 2>/dev/null || true
code=0
wait "$pid" || code=$?
rm -f "$work/$target.pid"
number() { sed -n "s/^stat::$1: *//p" "$log" | tail -1; }
edges=$(grep -o 'cov: [0-9]*' "$log" | tail -1 | cut -d' ' -f2)
ended=$([ "$code" = 0 ] && echo "no find" || echo "find, status $code")
printf '%s\t%s\t%s\t%s\t%s\t%s\t%s\n' "$target" "$commit" "$used" "$(number number_of_executed_units)" "$edges" "$(number peak_rss_mb)" "$ended" | tee -a "$work/log.tsv"
exit "$code"
