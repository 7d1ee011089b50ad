#!/bin/sh
# make rivals: renders the scenes of tests/measure/rivals.c by this library and by others that can be installed as packages:
# Blender's Cycles, POV-Ray, vdb_render of OpenVDB's tools, and VTK's ray caster. Prints Markdown, and draws
# docs/rivals_curves.png and docs/rivals_pictures.png. CONTESTS="name name" renders only these. Fetches what is missing
# where that is possible; a rival that is not there, and a scene without its data, are left out, with a message. Truths
# are kept in build/rivals; `make clean` makes them new.

set -u
cd "$(dirname "$0")/../.." || exit 1
BUILD=$PWD/build/rivals
RIVALS=$PWD/build/measure/rivals
RESULTS=$BUILD/results.txt
SIZE=256
THREADS=2
VTK=vtkmodules.vtkRenderingVolumeOpenGL2

has() { command -v "$1" > /dev/null; }

fetch() {
    [ "$(id -u)" = 0 ] && has apt-get || return 0
    { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@"; } > /dev/null 2>&1
}

# python_of MODULE: a Python that has it; where there are several, the system's has its packages.
python_of() {
    for python in python3 /usr/bin/python3; do
        "$python" -c "import numpy, $1" 2> /dev/null && echo "$python" && return
    done
}

# number NAME: of the scene
number() { awk -v name="$1" '$1 == name { for (i = 2; i <= NF; ++i) printf "%s%.9g", (i > 2 ? "," : ""), $i }' "$folder/scene.txt"; }

# measured WHO SETTING PICTURE START COMMAND...: renders, and adds the line of a result. START: time of an empty picture
measured() {
    who=$1 setting=$2 picture=$3 start=$4
    shift 4
    took=$("$RIVALS" time "$@" 2> "$BUILD/$who.log") || {
        echo "failed: $who, $scene, $setting: see build/rivals/$who.log" >&2
        return
    }
    echo "$scene|$who|$setting|$picture|$took|$start" >> "$RESULTS"
    echo "$scene: $who, $setting: $took" >&2
}

# Start-up: the time of a command that renders a picture of 8 x 8 pixels, once its files are in memory
empty() {
    "$@" > "$BUILD/empty.log" 2>&1
    took=$("$RIVALS" time "$@" 2> "$BUILD/empty.log") || echo "failed: $scene, start-up: see build/rivals/empty.log" >&2
    echo "${took%% *}"
}

# run_ours WORDS...: of each grade
run_ours() {
    start=$(empty "$RIVALS" ours "$scene" 0 8 "$folder/empty.pfm")
    grade=0
    for setting in "$@"; do
        measured splatshadow "$setting" "$folder/ours_$grade.pfm" "$start" "$RIVALS" ours "$scene" $grade $SIZE "$folder/ours_$grade.pfm"
        grade=$((grade + 1))
    done
}

# The command for a picture of some pixels, and declarations
pov() {
    pixels=$1 out=$2
    shift 2
    echo povray +Itests/measure/rivals.pov "+L$folder" "+W$pixels" "+H$pixels" -A -D "+WT$THREADS" File_Gamma=1 +FP16 "+O$out" "$@"
}

# run_pov SETTINGS...: samples, or samples,suns
run_pov() {
    # shellcheck disable=SC2046
    start=$(empty $(pov 8 "$folder/empty.ppm" Declare=Samples=1 Declare=Suns=3))
    for setting in "$@"; do
        samples=${setting%,*} suns=${setting#*,} words="${setting%,*} samples"
        [ "$setting" = "$suns" ] && suns=1 || words="$words, $suns x $suns suns"
        # shellcheck disable=SC2046
        measured POV-Ray "$words" "$folder/pov_$setting.ppm" "$start" $(pov $SIZE "$folder/pov_$setting.ppm" "Declare=Samples=$samples" "Declare=Suns=$suns")
    done
}

# run_cycles SETTINGS...: samples,step in voxels of the finer grid
run_cycles() {
    render="blender -b --factory-startup -P tests/measure/rivals.py -- $folder"
    # shellcheck disable=SC2086
    start=$(empty $render 1 4 8 "$folder/empty.exr")
    for setting in "$@"; do
        samples=${setting%,*} words="${setting%,*} samples"
        [ "$samples" != 1 ] || words="1 sample"
        # shellcheck disable=SC2086
        measured Cycles "$words, steps of ${setting#*,}" "$folder/cycles_$setting.exr" "$start" \
            $render "$samples" "${setting#*,}" $SIZE "$folder/cycles_$setting.exr"
    done
}

# The command for a picture of some pixels; step,shadow step in voxels of the finer grid
vdb() {
    pixels=$1 out=$2 step=$3
    scatter=$(awk '{ of[$1] = $2 } END { printf "%.9g", of["Extinction"] * of["Edge"] * of["Albedo"] }' "$folder/scene.txt")
    absorb=$(awk '{ of[$1] = $2 } END { printf "%.9g", of["Extinction"] * of["Edge"] * (1 - of["Albedo"]) }' "$folder/scene.txt")
    color=$(awk '$1 == "Irradiance" { printf "%.9g", $2 / (4 * 3.14159265358979) }' "$folder/scene.txt")
    fov=$(awk '$1 == "Half" { printf "%.9g", 2 * atan2($2, 1) * 180 / 3.14159265358979 }' "$folder/scene.txt")
    target=$(awk '$1 == "Eye" { split($0, eye) } $1 == "Ahead" { split($0, ahead) } END { printf "%.9g,%.9g,%.9g", eye[2] + ahead[2], eye[3] + ahead[3], eye[4] + ahead[4] }' "$folder/scene.txt")
    echo vdb_render "$folder/density.vdb" "$out" -res "${pixels}x$pixels" -cpus $THREADS -compression none -camera persp -fov "$fov" \
        -translate "$(number Eye)" -lookat "$target" -gain 0 -cutoff 1e-7 -light "$(number Toward),$color,$color,$color" \
        -scatter "$scatter,$scatter,$scatter" -absorb "$absorb,$absorb,$absorb" -step "${step%,*}" -shadowstep "${step#*,}"
}

# run_vdb SETTINGS...: step,shadow step
run_vdb() {
    # shellcheck disable=SC2046
    start=$(empty $(vdb 8 "$folder/empty.exr" 4,4))
    for setting in "$@"; do
        # shellcheck disable=SC2046
        measured vdb_render "steps of ${setting%,*}, shadows of ${setting#*,}" "$folder/vdb_$setting.exr" "$start" \
            $(vdb $SIZE "$folder/vdb_$setting.exr" "$setting")
    done
}

# run_vtk SETTINGS...: steps in voxels of the scan
run_vtk() {
    render="$PYTHON_OF_VTK tests/measure/rivals.py $folder"
    # shellcheck disable=SC2086
    start=$(empty $render 1 8 "$folder/empty.pfm")
    for setting in "$@"; do
        # shellcheck disable=SC2086
        measured VTK "steps of $setting" "$folder/vtk_$setting.pfm" "$start" $render "$setting" $SIZE "$folder/vtk_$setting.pfm"
    done
}

# begin SCENE: makes what all need; returns non-zero if its data is not there
begin() {
    scene=$1 folder=$BUILD/$1
    case " ${CONTESTS:-$1} " in *" $1 "*) ;; *) return 1 ;; esac
    mkdir -p "$folder"
    "$RIVALS" ours "$scene" 0 8 "$folder/empty.pfm" >&2 || { echo "skipped: $scene" >&2; return 1; }
    [ -f "$folder/density.raw" ] || "$RIVALS" prepare "$scene" "$folder" || return 1
    [ -f "$folder/truth.txt" ] || "$RIVALS" truth "$scene" "$folder" || return 1
}

# voxels: for OpenVDB; returns non-zero if they cannot be written
voxels() {
    [ -n "$PYTHON" ] && { [ -f "$folder/density.vdb" ] || "$PYTHON" tests/measure/rivals.py "$folder"; }
}

# with RIVAL SETTINGS...: if it is there
with() {
    rival=$1
    shift
    case $rival in
    pov) ! has povray || run_pov "$@" ;;
    cycles) ! has blender || ! voxels || run_cycles "$@" ;;
    vdb) ! has vdb_render || ! voxels || run_vdb "$@" ;;
    vtk) [ -z "$PYTHON_OF_VTK" ] || run_vtk "$@" ;;
    esac
}

# A package's version as installed, without its revision by the distribution
version() { dpkg-query -W -f '${Version}' "$1" 2> /dev/null | sed 's/^[0-9]*://; s/[-+].*//'; }

versions() {
    has blender && printf 'Blender %s with Cycles, ' "$(version blender)"
    has povray && printf 'POV-Ray %s, ' "$(version povray)"
    has vdb_render && printf 'vdb_render of OpenVDB %s, ' "$(version libopenvdb-tools)"
    [ -n "$PYTHON_OF_VTK" ] && printf 'VTK %s, ' "$(version python3-vtk9)"
    printf '%s threads each; %s processors' "$THREADS" "$(getconf _NPROCESSORS_ONLN)"
    printf '%s under %s; %s x %s pixels.\n' "$(sed -n 's/^model name[^:]*: /, /p' /proc/cpuinfo 2> /dev/null | head -1)" "$(uname -s)" "$SIZE" "$SIZE"
}

has povray || fetch povray
has vdb_render || fetch libopenvdb-tools
has blender || fetch blender
[ -n "$(python_of pyopenvdb)" ] || fetch python3-numpy python3-openvdb
[ -n "$(python_of "$VTK")" ] || fetch python3-numpy python3-vtk9
PYTHON=$(python_of pyopenvdb)
PYTHON_OF_VTK=$(python_of "$VTK")
has povray || echo "skipped: POV-Ray: install povray" >&2
has vdb_render || echo "skipped: vdb_render: install libopenvdb-tools" >&2
has blender || echo "skipped: Cycles: install blender" >&2
[ -n "$PYTHON" ] || echo "skipped: Cycles and vdb_render: install python3-numpy and python3-openvdb" >&2
[ -n "$PYTHON_OF_VTK" ] || echo "skipped: VTK: install python3-numpy and python3-vtk9" >&2

# What `rivals ours` sets at its first three grades; at the fourth it sets nothing
DRAFT="draft, slab 4, tolerance 0.1"
MEDIUM="medium, tolerance 0.02"
HIGH="high, tolerance 0.005"

: > "$RESULTS"
if begin blob; then
    run_ours "$DRAFT" "$MEDIUM" "$HIGH"
    with cycles 8,8 32,8 128,8
    with pov 8 20 40
fi
if begin smoke; then
    run_ours "$DRAFT" "$MEDIUM" "$HIGH"
    with cycles 8,4 32,2 128,2
    with pov 20 40 80
fi
if begin alone; then
    run_ours "$DRAFT" "$MEDIUM" "$HIGH"
    with cycles 8,4 32,2 128,2
    with pov 20 40 80
    with vdb 4,2 4,0.5 2,0.25
fi
if begin ring; then
    run_ours "$DRAFT" "$MEDIUM" "$HIGH"
    with cycles 8,4 32,4 128,4
    with pov 10 20 40
fi
if begin sun; then
    run_ours "$DRAFT, 4 points" "$MEDIUM, 16 points" "$HIGH, 64 points"
    with cycles 8,4 32,2 128,2
    with pov 12,3 24,3 36,5
fi
if begin cloud; then
    run_ours "$DRAFT, 32 cells" "$MEDIUM, 64 cells" "$HIGH, 128 cells" default
    with cycles 1,4 8,4 32,4 128,4
fi
if begin scan; then
    run_ours draft medium high
    with vtk 1 0.5 0.25 0.125
fi
printf '## Results\n\n'
versions
"$RIVALS" page docs "$RESULTS" "$BUILD"
