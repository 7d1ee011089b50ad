# sh tests/measure/turns.sh PART BASE [BUILD...]: rows of a part of build/measure/BASE and of up to two other builds of
# bench: medians of a build's figure over that of the base. With the base alone: its figures. All run at once, and wait
# for a line before each figure, so that figures take turns. GOAL='<= 1.2': instead of the rows' own goals.
part=$1
shift
folder=$(mktemp -d) || exit 1
trap 'rm -rf "$folder"' EXIT
fd=3
for build; do
    mkfifo "$folder/in$fd" "$folder/out$fd" || exit 1
    build/measure/$build $part < "$folder/in$fd" > "$folder/out$fd" &
    eval "exec $fd> $folder/in$fd $((fd + 3))< $folder/out$fd"
    fd=$((fd + 1))
done
trap '' PIPE # a build that has ended reads no more

take_turns() {
    while :; do
        fd=3
        for build; do
            eval "echo >&$fd" 2> /dev/null
            while :; do
                eval "read -r line <&$((fd + 3))" || return
                case $line in "|"*) echo "$build $line" && break ;; esac
            done
            fd=$((fd + 1))
        done
    done
}

take_turns "$@" | awk -F ' *[|] *' -v builds="$*" -v own_goal="$GOAL" '
function median(build, name,    n, i, j, list) {
    n = seen[build, name]
    for (i = 1; i <= n; ++i) {
        for (j = i; j > 1 && list[j - 1] > value[build, name, i]; --j) list[j] = list[j - 1]
        list[j] = value[build, name, i]
    }
    return list[int((n + 1) / 2)]
}
function row(build, name, goal,    ratio, over) {
    if (count == 1) return sprintf("| %s | %.3g%s | | %s with BEFORE | | |", name, median(build, name), unit[name], goal)
    ratio = median(build, name)
    over = ratio / substr(goal, 4)
    return sprintf("| %s: %s / %s | %.3g | %.3g%s by %s | %s | | %s |", name, build, base, ratio, median(base, name),
        unit[name], base, goal, goal == "" ? "" : over <= 1 ? "met" : sprintf("missed by %.0f %%", 100 * (over - 1)))
}
BEGIN {
    count = split(builds, list, " ")
    base = list[1]
}
$3 + 0 > 0 {
    n = ++seen[$1, $2]
    if ($1 == base) latest[$2] = $3
    value[$1, $2, n] = $1 == base ? $3 + 0 : $3 / latest[$2]
    if ($1 == base && n == 1) names[++rows] = $2
    unit[$2] = $3 ~ / s$/ ? " s" : ""
    goals[$2] = own_goal ? own_goal : $5
}
END {
    for (b = count > 1 ? 2 : 1; b <= count; ++b)
        for (i = 1; i <= rows; ++i)
            if (seen[list[b], names[i]]) print row(list[b], names[i], goals[names[i]])
}'
