#!/usr/bin/env bash
# Builds everything and passes the tests, from a bare Debian 12 machine on.
set -euo pipefail

usage() {
  cat <<END
Usage: tests/run.sh [--no-install] [--asan] [--tsan] [--coverage] [--fuzz] [--long] [--benchmarks] [-- CTEST_OPTIONS...]

Installs missing packages (needs root or sudo, once), builds the release preset and runs its tests:
ctest says how many passed and failed, a line after it how many were skipped and why. Then, where Clang with libFuzzer is present, the
fuzzers of all readers run for a minute in all (CAMBER_FUZZ_SECONDS changes that; 0: not at all) from
one random seed (CAMBER_FUZZ_SEED changes it, 0: another in each run). After more than 40 minutes of
building and testing they are left out, since they are a second build (CAMBER_FUZZ_LATEST: in minutes).

  --asan        instead, build with the address and undefined-behaviour sanitizers and run the unit
                tests
  --tsan        instead, build what computes on several threads with the thread sanitizer and run its
                tests
  --coverage    instead, build for coverage, run the tests and report the lines and branches that they
                reach, by module, and what each fuzzer's seeds reach; fails where the readers of files
                have less than 90 % of their lines
  --fuzz        instead, only the fuzzers; Clang is installed for them
  --long        also the tests that take minutes: the Debian packages, built, checked, installed
                into a fresh system (root, mmdebstrap and a mirror) and run; and some twenty minutes
                of faults of the machine at the calls of every command, 10,000 bad inputs, 200 kills
  --benchmarks  after the tests, run the benchmarks; their JSON goes to build/release/benchmarks
  --no-install  take the packages as they are
  -- OPTIONS    go to ctest, without the fuzzers: tests/run.sh -- -R road
END
}

install=true
mode=release
benchmarks=false
ctest_options=()
fuzz_seconds=${CAMBER_FUZZ_SECONDS:-60}
fuzz_seed=${CAMBER_FUZZ_SEED:-1}
fuzz_latest=${CAMBER_FUZZ_LATEST:-40}
while [ $# -gt 0 ]; do
  case "$1" in
    --no-install) install=false ;;
    --asan) mode=asan ;;
    --tsan) mode=tsan ;;
    --coverage) mode=coverage ;;
    --fuzz) mode=fuzz ;;
    --long) export CAMBER_LONG_TESTS=1 ;;
    --benchmarks) benchmarks=true ;;
    -h | --help) usage; exit 0 ;;
    --) shift; ctest_options=("$@"); break ;;
    *) printf 'run.sh: unknown option %s\n' "$1" >&2; usage >&2; exit 2 ;;
  esac
  shift
done

for name in fuzz_seconds fuzz_seed fuzz_latest; do
  if ! [[ ${!name} =~ ^[0-9]+$ ]]; then
    printf 'run.sh: CAMBER_%s is "%s", expected a whole number\n' "${name^^}" "${!name}" >&2
    exit 2
  fi
done
cd "$(dirname "${BASH_SOURCE[0]}")/.."
if $install; then
  packages=(--tests)
  if [ "$mode" = fuzz ]; then packages+=(--clang); fi
  samples/install_packages.sh "${packages[@]}"
fi

log=$(mktemp)
trap 'rm -f "$log" "$log.fuzzer" "$log.xml"' EXIT
# Runs a step and shows its output only if it fails.
quietly() {
  local what=$1
  shift
  if ! "$@" >"$log" 2>&1; then
    cat "$log" >&2
    printf 'run.sh: %s failed: the output is above\n' "$what" >&2
    exit 1
  fi
}
build() {
  echo "Building the preset $1 ..."
  quietly "configuring" cmake --preset "$@"
  quietly "the build" cmake --build --preset "$1" --parallel "$(nproc)"
}
# One line: how many tests were skipped and why, from ctest's JUnit file. The line after
# GoogleTest's "FILE:LINE: Skipped" is the reason, up to its first colon, behind which stands what
# differs from test to test; without one it is what ctest says itself.
count_skipped() {
  local reasons
  reasons=$(awk '
    /<testcase / { skipped = 0; is_reason = 0 }
    /<skipped / { skipped = 1; reason = $0; sub(/.*message="/, "", reason); sub(/".*/, "", reason) }
    is_reason { reason = $0; sub(/: .*/, "", reason); is_reason = 0 }
    /: Skipped$/ { is_reason = 1 }
    /<\/testcase>/ && skipped { print reason }' "$1" |
    sed -e "s/&quot;/\"/g; s/&apos;/'/g; s/&lt;/</g; s/&gt;/>/g; s/&amp;/\&/g")
  if [ -z "$reasons" ]; then
    echo "0 skipped"
    return
  fi
  sort <<<"$reasons" | uniq -c | sort -k1,1nr -k2 |
    awk '{ all += $1; $1 = $1; list = list (NR == 1 ? ": " : ", ") $0 }
         END { print all " skipped" list }'
}
# ctest without the lines of the tests that pass.
run_ctest() {
  local status=0 which=(--test-dir "build/$1")
  if [ "$1" = tsan ] || [ "$1" = coverage ]; then which=(--preset "$1"); fi
  ctest "${which[@]}" --output-on-failure --parallel 2 --output-junit "$log.xml" \
    --test-output-size-passed 65536 "${ctest_options[@]}" "${@:2}" >"$log" 2>&1 || status=$?
  grep -vE '^ +Start +[0-9]+: |^ *[0-9]+/[0-9]+ Test .* +Passed +[0-9.]+ sec$' "$log" || true
  if [ -s "$log.xml" ]; then count_skipped "$log.xml"; fi
  return $status
}

# Whether Clang makes programs with libFuzzer (its runtime is a package of its own).
has_fuzzer() {
  command -v clang++ >/dev/null &&
    clang++ -fsanitize=fuzzer,address -x c++ - -o "$log.fuzzer" >/dev/null 2>&1 \
      <<<'extern "C" int LLVMFuzzerTestOneInput(const unsigned char*, unsigned long) { return 0; }'
}
run_fuzzers() {
  build fuzz
  local fuzzers=(build/fuzz/bin/fuzz_*) program name findings folders
  local seconds=$((fuzz_seconds / ${#fuzzers[@]}))
  if [ "$seconds" -lt 1 ]; then seconds=1; fi
  for program in "${fuzzers[@]}"; do
    name=${program##*/}
    findings=build/fuzz/findings/$name
    mkdir -p "$findings/corpus"
    # New inputs go to the first folder; the seeds are the small files that the project keeps.
    folders=("$findings/corpus")
    if [ -d "tests/fuzz/corpus/${name#fuzz_}" ]; then
      folders+=("tests/fuzz/corpus/${name#fuzz_}")
    fi
    quietly "$name" "$program" -seed="$fuzz_seed" -max_total_time="$seconds" -rss_limit_mb=2048 \
      -print_final_stats=1 -artifact_prefix="$findings/" "${folders[@]}"
    printf '%s: %s executions, nothing found\n' "$name" \
      "$(awk '/^stat::number_of_executed_units/ { print $2 }' "$log")"
  done
}

case "$mode" in
  release)
    build release -DCAMBER_BUILD_TESTS=ON -DCAMBER_BUILD_SAMPLES=ON -DCAMBER_BUILD_BENCHMARKS=ON
    failed=false
    run_ctest release || failed=true
    if [ ${#ctest_options[@]} -eq 0 ] && [ "$fuzz_seconds" -gt 0 ]; then
      if [ "$SECONDS" -ge $((60 * fuzz_latest)) ]; then
        echo "After $((SECONDS / 60)) minutes the fuzzers are left out: tests/run.sh --fuzz runs them"
      elif has_fuzzer; then
        run_fuzzers
      else
        echo "No Clang with libFuzzer here: the fuzzers did not run (their seeds did, above)"
      fi
    fi
    if $failed; then exit 1; fi
    if $benchmarks; then
      results=build/release/benchmarks
      mkdir -p "$results"
      shopt -s nullglob
      for program in build/release/bin/bench_* tests/benchmarks/bench_*.py; do
        name=${program##*/bench_}
        name=${name%.py}
        printf '\n%s\n' "${program##*/}"
        if [ "$name" = reconstruct ]; then  # Google Benchmark's
          "$program"
        else
          "$program" --json "$results/$name.json"
        fi
      done
      printf '\nThe page of results is made from these by\n  %s %s --store %s --out %s\n' \
        tests/benchmarks/make_benchmark_md.py "$results" tests/benchmarks/results \
        tests/benchmarks/BENCHMARK.md
    fi
    ;;
  asan)
    build asan
    run_ctest asan --label-exclude 'package|benchmark'
    ;;
  tsan)
    build tsan
    run_ctest tsan
    ;;
  coverage)
    build coverage
    find build/coverage -name '*.gcda' -delete
    failed=false
    run_ctest coverage || failed=true
    tests/coverage.py build/coverage
    if $failed; then exit 1; fi
    ;;
  fuzz)
    run_fuzzers
    ;;
esac
