# sh tests/shaders.sh COMPILER FOLDER: compiles examples/shaders/ with glslangValidator, glslc or dxc, together with the
# excerpt that docs/shadow_maps.md shows. Files go to FOLDER. The last line is `N passed, N failed`.

compiler=$1 folder=$2 shaders=examples/shaders/transmittance_map
passed=0 failed=0

excerpt() {
    sed -n '/^```glsl$/,/^```$/ { /^```/d; p; }' docs/shadow_maps.md
}

# The sum uses both kinds of lookup.
sum='light_left(world_position) + light_left_of_cube(world_position, world_position.zyx)'

# glsl "#version .." AFTER: the file as an engine passes it to a driver, with standard input before it and AFTER after it.
glsl() {
    echo "$1" && cat - "$shaders.glsl" && echo "$2" && excerpt &&
        echo 'layout(location = 0) in vec3 world_position; layout(location = 0) out vec4 color;' &&
        echo "void main() { color = vec4($sum); }"
}

hlsl() {
    echo '#include "transmittance_map.hlsl"' && excerpt | sed 's/vec3/float3/g' &&
        echo "float4 main(float3 world_position : TEXCOORD0) : SV_Target { return $sum; }"
}

own_buffers() {
    echo 'layout(std430, binding = 0) readonly buffer Floats { float floats[]; };'
    echo 'layout(std430, binding = 1) readonly buffer Numbers { uint numbers[]; };'
    echo 'layout(binding = 2) uniform sampler2D surfaces;'
    echo '#define TMAP_TEXEL(map, i)   floats[i]'
    echo '#define TMAP_SURFACE(map, i) texelFetch(surfaces, ivec2((i) % (map).width, (i) / (map).width), 0).x'
    echo '#define TMAP_PLANE(map, i)   floats[1000 + (i)]'
    echo '#define TMAP_START(map, i)   numbers[i]'
    echo '#define TMAP_FRONT(map, i)   floats[2000 + (i)]'
    echo '#define tmap_bound own_map'
}

# textures "#version .." QUALIFIERS: the same for exported maps, with planes.
textures() {
    echo "$1" && echo '#define TMAP_TEXTURE' && echo '#define TMAP_PLANES' && cat "$shaders.glsl" &&
        echo "$2 in vec3 world_position; $2 out vec4 color; void main() {" && looks 'color = vec4' && echo '}'
}

# looks TO: every function for exported maps
looks() {
    echo 'tmap_place place = tmap_project(tmap_bound, world_position);' &&
        echo 'tmap_place other = tmap_clamp_place(tmap_bound, tmap_project_to_cube(tmap_bound, world_position));' &&
        echo "$1(tmap_filtered(tmap_bound, place), tmap_transmittance(tmap_bound, other)," &&
        echo 'tmap_mean_transmittance(tmap_bound, place), tmap_fade(tmap_bound, place, 8.0));'
}

hlsl_textures() {
    echo '#define TMAP_TEXTURE' && echo '#include "transmittance_map.hlsl"' &&
        echo 'float4 main(float3 world_position : TEXCOORD0) : SV_Target {' && looks 'return float4' && echo '}'
}

# six_way "#version ..": examples/shaders/six_way.glsl, used as its comment says.
six_way() {
    echo "$1" && echo 'precision highp float;' && cat examples/shaders/six_way.glsl &&
        echo 'uniform sampler2D map_a, map_b; in vec3 at; out vec4 color; void main() {' &&
        echo 'vec4 a = texture(map_a, at.xy), b = texture(map_b, at.xy);' &&
        echo 'color = vec4(six_way_radiance(a, b, normalize(at)), b.w, 0.0, a.w); }'
}

# The same in HLSL, with the definitions that the comment shows.
six_way_hlsl() {
    sed -n 's/^ *\(#define .*\)/\1/p' examples/shaders/six_way.glsl | sed 3q && echo '#include "six_way.glsl"' &&
        echo 'float4 main(float4 a : TEXCOORD0, float4 b : TEXCOORD1, float3 at : TEXCOORD2) : SV_Target {' &&
        echo 'return six_way_radiance(a, b, normalize(at)); }'
}

# check FILE COMMAND..: runs a command on FILE
check() {
    file=$1 && shift
    if "$@" "$file" > "$file.log" 2>&1; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1)) && echo "failed: $* $file" && cat "$file.log"
    fi
}

glsl '#version 430' < /dev/null > "$folder/$compiler.430.frag"
glsl '#version 310 es' < /dev/null > "$folder/$compiler.es.frag"
glsl '#version 450' < /dev/null > "$folder/$compiler.450.frag"
own_map='layout(std140, binding = 3) uniform Own { tmap own_map; };'
own_buffers | glsl '#version 450' "$own_map" > "$folder/$compiler.own.frag"
hlsl > "$folder/$compiler.hlsl"
textures '#version 330' > "$folder/$compiler.textures_330.frag"
textures '#version 430' > "$folder/$compiler.textures_430.frag"
textures '#version 300 es' > "$folder/$compiler.textures_300es.frag"
textures '#version 310 es' > "$folder/$compiler.textures_310es.frag"
textures '#version 450' 'layout(location = 0)' > "$folder/$compiler.textures_450.frag"
hlsl_textures > "$folder/$compiler.textures.hlsl"
six_way '#version 130' > "$folder/$compiler.six_way_130.frag"
six_way '#version 300 es' > "$folder/$compiler.six_way_es.frag"
six_way_hlsl > "$folder/$compiler.six_way.hlsl"
object=$folder/$compiler.spv

case $compiler in
glslangValidator)
    for version in 430 es 450 own six_way_130 six_way_es textures_330 textures_430 textures_300es textures_310es; do
        check "$folder/$compiler.$version.frag" glslangValidator
    done
    for file in 450.frag hlsl textures_450.frag textures.hlsl six_way.hlsl; do
        case $file in *hlsl) language='-D -S frag -e main' ;; *) language= ;; esac
        check "$folder/$compiler.$file" glslangValidator -V $language -Iexamples/shaders -o "$object"
        command -v spirv-val > /dev/null && check "$object" spirv-val
    done
    ;;
glslc)
    for version in 450 own textures_450; do check "$folder/$compiler.$version.frag" glslc -o "$object"; done
    for file in hlsl textures.hlsl six_way.hlsl; do
        check "$folder/$compiler.$file" glslc -x hlsl -fshader-stage=fragment -fentry-point=main -Iexamples/shaders -o "$object"
    done
    ;;
dxc)
    for file in hlsl textures.hlsl six_way.hlsl; do
        check "$folder/$compiler.$file" dxc -T ps_6_0 -E main -I examples/shaders -Fo "$object"
    done
    ;;
esac
echo "$passed passed, $failed failed"
[ "$failed" = 0 ]
