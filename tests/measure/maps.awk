# The page docs/maps.md from what maps.c prints: sections of single scenes become one table, of the errors with 8 floats,
# and times are those of maps of that size.
/^## (Reading|Puff|Wind|Clumps|Shell|Core|Ball)/ {
    scene = $2
    sub(/:$/, "", scene)
    if (scene != "Reading") scenes[++scene_count] = scene
    single = 1
    next
}
/^## / { if (single) print_table(); single = 0 }
single && substr($0, 31, 2) == "8 " && /\|/ {
    name = substr($0, 1, 30)
    sub(/ +$/, "", name)
    if (!(name in known)) names[++name_count] = name
    known[name] = 1
    split($0, part, "|")
    if (scene == "Puff") flicker[name] = last_word(part[2])
    sub(/^ +/, "", part[2])
    sub(/ .*/, "", part[2])
    error[name, scene] = part[2]
}
/^## Times/ { times = 1 }
times && !single && /^[a-zA-Z]/ && !/^Beer/ && substr($0, 30, 2) ~ /^( 6|16|24)$/ { next }
!single { print }

function last_word(text,    count, words) {
    count = split(text, words, " ")
    return words[count]
}

function print_table(    i, k) {
    printf "## Errors with 8 floats\n\nRoot mean square errors of transmittance in the gas; flicker in the puff, as the light turns by 0.02 degrees a frame: rms of\nthe error's second difference. All other figures are in `build/maps.txt`.\n\n| with 8 floats |"
    for (k = 1; k <= scene_count; ++k) printf " %s |", tolower(scenes[k])
    printf " flicker |\n|---|---|"
    for (k = 1; k <= scene_count; ++k) printf "---|"
    printf "\n"
    for (i = 1; i <= name_count; ++i) {
        printf "| %s |", names[i]
        for (k = 1; k <= scene_count; ++k) printf " %s |", error[names[i], scenes[k]]
        printf " %s |\n", flicker[names[i]]
    }
    printf "\n"
}
