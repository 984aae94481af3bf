#!/usr/bin/env bash
# The network in the package, made again from the photo sets of docs/models.md: gardens, teachers' masks, two recipes, export.
# The file in the package is of a run that was stopped early (docs/models.md): expect another file, and measure it.
#   tools/train_lawn_robots.sh PHOTOS TEACHERS ROOT [--set without=non-commercial]
# PHOTOS holds the photo sets, TEACHERS the teachers' folders; ROOT gets everything. Every step goes on where it was.
set -euo pipefail
photos=$1 teachers=$2 root=$3
options=("${@:4}")
here=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$root"
# the network it begins from: that of 0.1.0's successor, which saw no robot's photos
[ -f "$root/start.onnx" ] || git -C "$here" show bbf8619:src/swardmap/data/models/lawn.onnx > "$root/start.onnx"
python "$here/tools/training_root.py" "$photos" "$root" --teachers "$teachers" --network "$root/start.onnx"
exact=(--no-sensor --set map.enabled=false --set rig.rate_hz=0.5)
odd=(--set 'camera.exposure_ev=[-2.2,1.0]' --set 'camera.white_balance=[-0.45,0.45]'
     --set 'camera.tint=[-0.12,0.12]' --set 'camera.saturation=[0.4,1.1]')
for garden in twilight:2105:40 sunset:2104:30 overcast:2103:24 cloudy:2102:24 clear:2101:24; do
  IFS=: read -r light seed scenes <<< "$garden"
  swardmap synth "$root/gardens/train-$light" --scenes "$scenes" --frames 3 --seed "$seed" --illumination "$light" "${exact[@]}" "${odd[@]}"
done
swardmap synth "$root/gardens/dev" --scenes 8 --frames 1 --seed 2002 --illumination all "${exact[@]}"
swardmap synth "$root/gardens/test" --scenes 20 --frames 1 --seed 3003 --illumination all "${exact[@]}"
swardmap train "$here/recipes/lawn-robots.yaml" --data "$root" --distil -o "$root/runs/lawn-robots" "${options[@]}"
swardmap train "$here/recipes/lawn-robots.yaml" --data "$root" -o "$root/runs/lawn-robots-200" --set schedule.steps=200 "${options[@]}"
swardmap train "$here/recipes/lawn-robots-fine.yaml" --data "$root" -o "$root/runs/lawn-robots-fine" "${options[@]}"
# a mixture of weights, that of the network it began from among them, keeps persons and lawn in shade (docs/models.md)
swardmap export "$root/runs/lawn-robots-fine/last.pt" --data "$root" --size 512 384 --calibrate-classes --grass-bias -0.6 \
  --blend "$root/runs/lawn-robots-200/last.pt" --blend-share 0.5 --blend "$root/runs/lawn-robots/start.pt" --blend-share 0.4 \
  -o "$root/lawn-robots.onnx"
python "$here/benchmarks/score_networks.py" "$root/start.onnx" "$root/lawn-robots.onnx" --data "$root"
