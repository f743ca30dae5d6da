#!/usr/bin/env bash
# The paper's KITTI tracking sequences: imported, run by the paper's method and by Camber's own, and
# judged in one table.
set -euo pipefail

usage() {
  cat <<END
Usage: samples/paper_kitti.sh KITTI_ROOT [KEYPOINTS.json] [options]

Runs sequences 1, 3, 7, 8, 9, 10, 11 and 20 of KITTI's tracking training set, three neighbouring
frames at a time, with --preset paper and with the default, and prints one table of both.

  KITTI_ROOT      the folder with training/ in it, or training/ itself: image_02/NNNN/, calib/NNNN.txt
                  and label_02/NNNN.txt. What is not there is named and left out.
  KEYPOINTS.json  36 keypoints of cars, a list of objects with sequence, frame, track_id (or
                  bbox_xyxy) and keypoints_uv_confidence; without it the keypoints are those of the
                  shipped network, and the table says so

  --out DIR       results and tables (default out/paper_kitti); what is there already is kept and
                  not run again
  --sequences L   other sequences, such as 9,20
  --every N       the first of each three frames is every N-th (default 10)
  --camber FILE   default: build/release/bin/camber, which samples/run.sh builds

The boxes are those of the labels, as in the paper. Three frames where the camera stands still have
no parallax and no answer: they are counted. Exit code 1: nothing could be judged, or no keypoint
belongs to a box of the sequences.
END
}

fail() {
  printf 'paper_kitti.sh: %s\n' "$1" >&2
  exit 2
}

here=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
out=out/paper_kitti
camber=$here/build/release/bin/camber
sequences=1,3,7,8,9,10,11,20
every=10
places=()
while [ $# -gt 0 ]; do
  case "$1" in
    --out | --sequences | --every | --camber)
      [ $# -ge 2 ] || fail "$1 needs a value"
      case "$1" in
        --out) out=$2 ;;
        --sequences) sequences=$2 ;;
        --every) every=$2 ;;
        --camber) camber=$2 ;;
      esac
      shift 2 ;;
    -h | --help) usage; exit 0 ;;
    -*) usage >&2; fail "unknown option $1" ;;
    *) places+=("$1"); shift ;;
  esac
done
if [ ${#places[@]} -lt 1 ] || [ ${#places[@]} -gt 2 ]; then
  usage >&2
  fail "found ${#places[@]} arguments, expected KITTI_ROOT and at most one KEYPOINTS.json"
fi
root=${places[0]}
keypoints=${places[1]-}
[[ $every =~ ^[1-9][0-9]{0,5}$ ]] || fail "--every: found '$every', expected a number from 1 on"
[[ $sequences =~ ^[0-9]{1,4}(,[0-9]{1,4})*$ ]] ||
  fail "--sequences: found '$sequences', expected numbers such as 9,20"
[ -x "$camber" ] || fail "there is no program $camber: run samples/run.sh first, or name it by --camber"
[ -d "$root/training" ] && root=$root/training
[ -d "$root/image_02" ] || fail "$root: found no image_02, expected KITTI's tracking set"
[ -z "$keypoints" ] || [ -f "$keypoints" ] || fail "$keypoints: no such file"

# Numbers of a sequence's images, ascending.
frames_of() {
  find -L "$1" -maxdepth 1 \( -name '*.png' -o -name '*.jpg' \) -printf '%f\n' |
    sed -nE 's/^0*([0-9]+)\.(png|jpg)$/\1/p' | sort -n
}

# First numbers of three neighbouring frames, at least `every` apart.
triples_of() {
  awk -v every="$every" '
    { present[$1] = 1; frames[++count] = $1 }
    END {
      next_start = -1
      for (i = 1; i <= count; ++i) {
        f = frames[i]
        if (f < next_start || !((f + 1) in present) || !((f + 2) in present)) continue
        print f
        next_start = f + every
      }
    }'
}

# The tables of `evaluate --markdown` as one, the method in its first column; what it states of each
# method goes before.
one_table() {
  awk '
    /^\|/ {
      if ($0 ~ /^\| distance/) { if (!head++) rows = rows "| method " $0 "\n"; next }
      if ($0 ~ /^\|---/) { if (head == 1 && !rule++) rows = rows "|---" $0 "\n"; next }
      rows = rows "| " method " " $0 "\n"
      next
    }
    NF { print $0 "\n"; method = $0; sub(/:.*/, "", method) }
    END { printf "%s", rows }'
}

mkdir -p "$out"
log=$out/log.txt
: >"$log"
# Results of one set of keypoints do not stand in for those of another.
inputs=boxes
[ -z "$keypoints" ] || inputs=keypoints_$(cksum <"$keypoints" | cut -d ' ' -f 1)
absent=()
truths=() papers=() defaults=() scenes=()
runs=0 unanswered=0
for sequence in ${sequences//,/ }; do
  number=$(printf '%04d' "$((10#$sequence))")
  missing=""
  [ -d "$root/image_02/$number" ] || missing="no image_02/$number"
  [ -f "$root/calib/$number.txt" ] || missing="${missing:+$missing, }no calib/$number.txt"
  [ -f "$root/label_02/$number.txt" ] || missing="${missing:+$missing, }no label_02/$number.txt"
  if [ -n "$missing" ]; then
    absent+=("$number ($missing)")
    continue
  fi
  mapfile -t frames < <(frames_of "$root/image_02/$number")
  if [ ${#frames[@]} -eq 0 ]; then
    absent+=("$number (no images)")
    continue
  fi
  gaps=$((frames[-1] - frames[0] + 1 - ${#frames[@]}))
  mapfile -t starts < <(printf '%s\n' "${frames[@]}" | triples_of)
  echo "sequence $number: ${#frames[@]} frames, ${frames[0]} to ${frames[-1]}$(
    [ "$gaps" -eq 0 ] || echo ", $gaps of these absent"); ${#starts[@]} times three"
  results=$out/$number/$inputs
  scene=$results/scene
  arguments=(--images "$root/image_02/$number" --calib "$root/calib/$number.txt"
    --labels "$root/label_02/$number.txt" --detections-from-labels --name "kitti_$number"
    --out "$scene")
  [ -z "$keypoints" ] ||
    arguments+=(--keypoints "$keypoints" --sequence "$((10#$sequence))")
  "$camber" import kitti "${arguments[@]}" --quiet 2>>"$log"
  scenes+=("$scene")
  for start in "${starts[@]}"; do
    for preset in paper default; do
      result=$results/$preset/$start
      runs=$((runs + 1))
      if ! [ -f "$result/run.json" ]; then
        mkdir -p "$results/$preset"
        code=0
        "$camber" reconstruct "$scene" --frames "$start:$((start + 2))" --preset "$preset" \
          --no-pictures --quiet --out "$result" 2>>"$log" || code=$?
        if [ "$code" -eq 1 ]; then
          unanswered=$((unanswered + 1))
          continue
        fi
        [ "$code" -eq 0 ] || { tail -n 1 "$log" >&2; exit "$code"; }
      fi
    done
    # Both are judged on the same frames.
    if [ -f "$results/paper/$start/run.json" ] && [ -f "$results/default/$start/run.json" ]; then
      truths+=("$scene")
      papers+=("$results/paper/$start")
      defaults+=("$results/default/$start")
    fi
  done
done

if [ ${#absent[@]} -gt 0 ]; then
  printf 'absent: '
  (IFS=';'; printf '%s\n' "${absent[*]}" | sed 's/;/; /g')
fi
echo "$runs runs, $unanswered without an answer (reasons in $log)"
# What was used stands in the scenes and in the results.
if [ -n "$keypoints" ] && [ ${#scenes[@]} -gt 0 ] &&
  ! grep -rq '"keypoints": *\[' "${scenes[@]}"; then
  echo "paper_kitti.sh: $keypoints: no keypoints for a box of these sequences" >&2
  exit 1
fi
if [ ${#truths[@]} -eq 0 ]; then
  echo 'paper_kitti.sh: no three frames were answered by both: nothing to judge' >&2
  exit 1
fi
{
  echo "# KITTI tracking, the paper's sequences"
  echo
  echo "Three frames at a time, ${#truths[@]} times. Boxes: those of the labels."
  if [ -n "$keypoints" ]; then
    echo "Keypoints: $(basename "$keypoints"); vehicles without any there by their boxes alone."
  elif grep -q '"keypoints": *{' "${papers[@]/%//run.json}" "${defaults[@]/%//run.json}"; then
    echo "Keypoints: those that the shipped network finds."
  else
    echo "Boxes alone, no keypoints: headings and distances follow from box, ground and size."
  fi
  [ ${#absent[@]} -eq 0 ] || { IFS=';'; echo "Absent: ${absent[*]}." | sed 's/;/; /g'; unset IFS; }
  echo
  "$camber" evaluate --truth "${truths[@]}" --estimate "${papers[@]}" "${defaults[@]}" --markdown |
    one_table
} >"$out/table.part"
mv "$out/table.part" "$out/table.md"
cat "$out/table.md"
