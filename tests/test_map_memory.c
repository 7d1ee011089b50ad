/* Transmittance maps: the same bits in any order, the bytes that maps take, and what happens if they are not there. */

#include "map_scene.h"

/* ------------------------------------------------------------------------------------------------------------ order */

/* The same bits for any number of workers, on every run, and for a scene added in several calls. */
static void test_same_bits(void) {
    static const int workers[5] = {0, 0, 1, 2, 7};
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int round = 0; round < 2; ++round) {
            check_hooks hooks[6];
            sps_context *contexts[6];
            sps_tmap *maps[6];
            for (int w = 0; w < 6; ++w) {
                fixture f;
                memset(&hooks[w], 0, sizeof hooks[w]);
                maps[w] = NULL, contexts[w] = NULL;
                if (check_memory_only() && w > 0 && w < 4) continue;
                hooks[w].worker_count = w < 5 ? workers[w] : 2;
                hooks[w].order = (uint64_t)w;
                contexts[w] = check_context(&hooks[w]);
                begin_mixed(&f, technique);
                f.s.volume[0].size[0] = f.s.volume[0].size[1] = f.s.volume[0].size[2] = 6;
                if (round) see(&f, ROUND, 7);
                if (!round && technique % 3 == 2) f.light.width = 67, f.light.height = 65; /* four tiles */
                f.settings.texel_range = technique == SPS_TMAP_FOURIER && round;
                if (w < 5) {
                    maps[w] = must_build(&f, contexts[w]);
                } else { /* in pieces */
                    sps_scene part;
                    complete(&f);
                    CHECK_OK(contexts[w], sps_tmap_create(contexts[w], &f.light, &f.settings, &maps[w]));
                    part = f.s.scene;
                    part.mesh_count = 1, part.particle_set_count = 0;
                    CHECK_OK(contexts[w], sps_tmap_add(maps[w], &part));
                    part = f.s.scene;
                    part.volume_count = 0, part.mesh_count = 0, part.particle_set_count = 1;
                    CHECK_OK(contexts[w], sps_tmap_add(maps[w], &part));
                    part.particles += 1, part.meshes += 1, part.mesh_count = 1;
                    CHECK_OK(contexts[w], sps_tmap_add(maps[w], &part));
                    CHECK_OK(contexts[w], sps_tmap_finish(maps[w]));
                }
                end(&f);
                if (!CHECK(maps[w] && maps[0] && same_map(maps[0], maps[w])))
                    printf("    technique %d, %d workers, case %d\n", technique, hooks[w].worker_count, w);
            }
            for (int w = 0; w < 6; ++w) {
                sps_tmap_destroy(maps[w]);
                sps_destroy(contexts[w]);
                CHECK(hooks[w].live == 0 && hooks[w].live_blocks == 0);
            }
        }
}

/* A set without particles leaves compressed maps as they are, soft or not. */
static void test_empty_soft_set(void) {
    sps_context *context = sps_create(NULL, NULL);
    sps_tmap *uniform, *soft;
    fixture f;
    begin(&f, SPS_TMAP_COMPRESSED);
    scatter(&f, 1, 20, 5, 4);
    f.sets[1].soft = 0;
    uniform = must_build(&f, context);
    f.sets[0].soft = 1;
    soft = must_build(&f, context);
    CHECK(uniform && soft && same_map(uniform, soft));
    sps_tmap_destroy(uniform);
    sps_tmap_destroy(soft);
    sps_destroy(context);
}

/* A Beer map has where a texel's gas begins, where it ends, and all of its depth; it is a deep opacity map of one
   plane: the same bits. One even particle is exact anywhere; two sheets at the ends of the range, and one alone, count
   where they are. */
static void test_beer(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int n = 0; n < 4; ++n) {
        fixture f;
        sps_tmap *maps[2];
        for (int i = 0; i < 2; ++i) {
            begin_mixed(&f, i ? SPS_TMAP_DEEP_OPACITY : SPS_TMAP_BEER);
            if (n % 2) see(&f, ROUND, SIDE);
            if (n >= 2) f.s.scene.mesh_count = f.s.scene.volume_count = 0, f.crowds[1].count = 0;
            if (n >= 2) f.crowds[0].count = 1, f.crowds[0].list[0].radius = 2.5f;
            f.settings.components = 3;
            maps[i] = must_build(&f, context);
            if (i == 0) end(&f);
        }
        CHECK(maps[0] && maps[1] && same_map(maps[0], maps[1]));
        for (int i = 0; i < SIDE * SIDE && maps[0] && n >= 2; ++i)
            for (int k = 0; k <= 20; ++k) {
                double point[3];
                answer exact;
                on_ray(maps[0], n % 2 ? i % 6 : 0, i % SIDE, i / SIDE, 20 * k / 20.0, point);
                exact = exact_particles(&f, point);
                CHECK_CASE("Found in review", "Beer maps of one even particle", "its optical depth",
                           fabs(query_at(maps[0], point) - exact.depth), exact.slack + 1e-5 * exact.depth,
                           "chords to 1e-3 at rims, as everywhere");
            }
        for (int i = 0; i < 2; ++i) sps_tmap_destroy(maps[i]);
        end(&f);
    }
    for (int n = 0; n < 3; ++n) { /* sheets: at z 0, alone; at 9.9 and at 9.9 and -9.9 */
        fixture f;
        sps_tmap *map;
        begin(&f, SPS_TMAP_BEER);
        add_square(&f, 0, -30, 30, 30, n ? 9.9 : 0);
        if (n == 2) add_square(&f, 0, -30, 30, 30, -9.9);
        add_mesh(&f, 0, 0.5);
        map = must_build(&f, context);
        CHECK_NEAR(query(map, 0, 0, n ? 9.95 : 0.05), 0, 0);
        CHECK_NEAR(query(map, 0, 0, -9.95), (n < 2 ? 1 : 2) * log(2), 1e-6);
        if (n < 2) CHECK_NEAR(query(map, 0, 0, n ? 9.85 : -0.05), log(2), 1e-6);
        sps_tmap_destroy(map);
        end(&f);
    }
    sps_destroy(context);
}

/* Shuffled particles: the same bits from lists, which are sorted, and the same up to the round-off of sums of 25
   floats. */
static void test_shuffled(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
        check_random random = {17};
        fixture f;
        sps_tmap *maps[2];
        begin_mixed(&f, technique);
        maps[0] = must_build(&f, context);
        for (int i = 0; i < 24; ++i) {
            crowd *c = &f.crowds[i % 2];
            const int a = i / 2, b = (int)(12 * check_next(&random));
            const sps_particle kept = c->list[a];
            c->list[a] = c->list[b], c->list[b] = kept;
        }
        maps[1] = must_build(&f, context);
        if (maps[0] && maps[1] && maps[0]->technique->lists && !CHECK(same_map(maps[0], maps[1])))
            printf("    technique %d\n", technique);
        for (size_t i = 0; maps[0] && maps[1] && !maps[0]->technique->lists && i < float_count(maps[0]); ++i) {
            const size_t n = (size_t)maps[0]->settings.components;
            const float *texel = sps_tmap_texels(maps[0]) + i / n * n;
            double scale = 0;
            for (size_t k = 0; k < n; ++k) scale = fmax(scale, fabs((double)texel[k]));
            CHECK_NEAR((double)sps_tmap_texels(maps[1])[i], (double)texel[i % n], 50 * 6e-8 * scale);
        }
        sps_tmap_destroy(maps[0]);
        sps_tmap_destroy(maps[1]);
        end(&f);
    }
    sps_destroy(context);
}

/* ----------------------------------------------------------------------------------------------------------- memory */

/* Destroys a map. Returns the bytes that this frees, without the link before each allocation. */
static size_t freed_by(sps_tmap *map, const check_hooks *hooks) {
    const size_t live = hooks->live;
    const long blocks = hooks->live_blocks;
    sps_tmap_destroy(map);
    return live - hooks->live - (size_t)(blocks - hooks->live_blocks) * SPSI_LINK_BYTES;
}

/* Every technique holds the bytes that it reports; if a texel's size is fixed, it reports them from the beginning,
   except for surfaces and fronts, which depend on the occluders. */
static void test_bytes(void) {
    for (int n = 0; n < 4 * TECHNIQUES; ++n) {
        const int technique = 1 + n / 4, opaque = n % 2, round = n / 2 % 2;
        check_hooks hooks;
        sps_context *context;
        fixture f;
        sps_tmap *map = NULL;
        size_t before, bytes;
        memset(&hooks, 0, sizeof hooks);
        context = check_context(&hooks);
        begin_little(&f, technique);
        if (round) see(&f, ROUND, SIDE);
        if (!opaque) check_translucent(&f.s.mesh[1], 0.3);
        complete(&f);
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
        before = check_bytes_of(map);
        CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
        CHECK(check_bytes_of(map) == before);
        CHECK_OK(context, sps_tmap_finish(map));
        bytes = check_bytes_of(map);
        if (technique > SPS_TMAP_COMPRESSED)
            CHECK(bytes ==
                  before + ((opaque ? 4u : 0u) + (sps_tmap_fronts(map) ? 4u : 0u)) * SIDE * SIDE * (round ? 6 : 1));
        else
            CHECK(bytes ==
                  before + sizeof(float) * (float_count(map) + (opaque ? (size_t)(SIDE * SIDE * (round ? 6 : 1)) : 0)));
        CHECK_NEAR((double)freed_by(map, &hooks), (double)bytes, 0);
        sps_destroy(context);
        CHECK(hooks.live == 0 && hooks.live_blocks == 0);
        end(&f);
    }
}

/* Maps made from lists, half of them empty: the map has exactly their size, however they grew from band to band of 64
   rows. */
static void test_bytes_of_half_empty_maps(void) {
    for (int n = 0; n < 9; ++n) {
        const int technique = n < 3 ? SPS_TMAP_DEEP : SPS_TMAP_COMPRESSED, half = n % 3; /* upper, lower, neither */
        const size_t item = technique == SPS_TMAP_DEEP ? sizeof(spsi_interval) : sizeof(spsi_node);
        enum { TALL = 200, TEXELS = TALL * TALL };
        size_t before, bytes;
        check_hooks hooks;
        sps_context *context;
        fixture f;
        sps_tmap *map = NULL;
        memset(&hooks, 0, sizeof hooks);
        context = check_context(&hooks);
        begin(&f, technique);
        f.settings.components = n < 6 ? 0 : 8;
        see(&f, ORTHO, TALL);
        scatter(&f, 0, half < 2 ? 9 : 0, 1, 5);
        for (size_t i = 0; i < f.crowds[0].count; ++i) {
            f.crowds[0].list[i].position[1] += half ? -2.6f : 2.6f;
            f.crowds[0].list[i].radius = 1.5f;
        }
        complete(&f);
        CHECK_OK(context, sps_tmap_create(context, &f.light, &f.settings, &map));
        before = check_bytes_of(map);
        CHECK_OK(context, sps_tmap_add(map, &f.s.scene));
        CHECK_OK(context, sps_tmap_finish(map));
        bytes = check_bytes_of(map);
        {
            const uint32_t *starts = sps_tmap_starts(map), count = starts[TEXELS], middle = starts[TEXELS / 2];
            CHECK(half == 2 ? count == 0 : count > 5000 && middle == (half ? 0 : count));
            if (!CHECK_CASE("Found in review", "bytes of lists of maps that are half empty", "exactly their items",
                            fabs((double)bytes - (double)(before + item * (count > 0 ? count : 1))), 0,
                            "exact; no allocation is of 0 bytes"))
                printf("    technique %d: %g bytes of %g items\n", technique, (double)(bytes - before), (double)count);
        }
        CHECK_NEAR((double)freed_by(map, &hooks), (double)bytes, 0);
        sps_destroy(context);
        CHECK(hooks.live == 0);
    }
}

/* A budget reduces a default number of components step by step, down to the technique's minimum, and reserves room for
   surfaces and fronts, which are not known yet, if possible; an explicit number is not changed. */
static void test_budget_of_components(void) {
    static const int least[TECHNIQUES + 1] = {0, 0, 0, 1, 3, 3, 5, 3}, step[TECHNIQUES + 1] = {0, 0, 0, 1, 1, 2, 2, 1};
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_OPACITY; technique <= TECHNIQUES; ++technique)
        for (int ranged = 0; ranged < (technique == SPS_TMAP_FOURIER ? 2 : 1); ++ranged) {
            const int fewest = least[technique] + 2 * ranged;
            size_t empty;
            int usual;
            sps_tmap_settings resolved;
            fixture f;
            sps_tmap *map;
            begin(&f, technique);
            f.settings.texel_range = ranged;
            map = must_build(&f, context);
            resolved = check_settings_of(map);
            usual = resolved.components;
            empty = check_bytes_of(map) - (size_t)(SIDE * SIDE * 4 * usual);
            sps_tmap_destroy(map);
            for (int n = usual + 1; n >= 0; --n) {
                f.settings.byte_budget = empty + (size_t)(SIDE * SIDE * 4 * n);
                f.settings.components = 0;
                map = build(&f, context);
                if (n < fewest) {
                    CHECK(!map && strstr(sps_error(context), "settings.byte_budget is "));
                } else if (CHECK(map != NULL)) {
                    resolved = check_settings_of(map);
                    CHECK(resolved.components <= n && resolved.components >= fewest && resolved.components <= usual);
                    CHECK(resolved.components + step[technique] > n - 2 || n > usual);
                    CHECK(resolved.components <= n - 2 || resolved.components == fewest);
                    CHECK(check_bytes_of(map) <= f.settings.byte_budget);
                }
                sps_tmap_destroy(map);
                f.settings.components = usual;
                map = build(&f, context);
                CHECK(!map == (n < usual));
                sps_tmap_destroy(map);
            }
        }
    sps_destroy(context);
}

/* Lists and surfaces, whose size depends on the occluders, are refused when it is known, with the number of bytes
   needed. */
static void test_budget_of_lists(void) {
    sps_context *context = sps_create(NULL, NULL);
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique) {
        size_t bytes;
        fixture f;
        sps_tmap *map;
        begin_little(&f, technique);
        map = must_build(&f, context);
        bytes = check_bytes_of(map);
        f.settings.components = map->settings.components;
        sps_tmap_destroy(map);
        for (int n = 0; n < 4; ++n) {
            const size_t less[4] = {0, 1, 300, bytes / 8};
            f.settings.byte_budget = bytes - less[n];
            map = build(&f, context);
            if (n == 0) {
                CHECK(map && check_bytes_of(map) == bytes);
            } else {
                const char *takes = strstr(sps_error(context), "the map takes ");
                CHECK_CASE("Found in review", "byte budgets that lists exceed", "an error that says what they take",
                           map || !strstr(sps_error(context), "settings.byte_budget is ") || !takes, 0, "exact");
                if (takes && !CHECK(atof(takes + 14) > (double)f.settings.byte_budget))
                    printf("    technique %d: %s, of %g\n", technique, sps_error(context), (double)bytes);
            }
            sps_tmap_destroy(map);
        }
        end(&f);
    }
    sps_destroy(context);
}

/* Each allocation fails in turn: an error, no leak, and the context is usable. A failure of sps_tmap_add leaves the map
   unchanged. */
static void test_allocations(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; ++technique)
        for (int last = 0, n = 1; !last; n += check_memory_only() ? 1 + n / 6 : 1) {
            check_hooks hooks;
            sps_context *context;
            fixture f;
            sps_tmap *map = NULL, *again;
            sps_result result;
            memset(&hooks, 0, sizeof hooks);
            hooks.worker_count = 2;
            context = check_context(&hooks);
            begin_little(&f, technique);
            complete(&f);
            hooks.fail_at = hooks.allocations + n;
            result = sps_tmap_create(context, &f.light, &f.settings, &map);
            if (result == SPS_OK) {
                result = sps_tmap_add(map, &f.s.scene);
                if (result == SPS_OK)
                    result = sps_tmap_finish(map);
                else if (CHECK_OK(context, sps_tmap_add(map, &f.s.scene)) && CHECK_OK(context, sps_tmap_finish(map))) {
                    again = must_build(&f, context);
                    CHECK(again && same_map(map, again));
                    sps_tmap_destroy(again);
                    sps_tmap_destroy(map);
                    map = NULL;
                }
            } else {
                CHECK(map == NULL);
            }
            last = hooks.allocations < hooks.fail_at;
            CHECK(result == (last ? SPS_OK : SPS_ERROR_MEMORY));
            sps_tmap_destroy(map);
            hooks.fail_at = 0;
            if (n % 5 == 1) check_renders(context);
            again = must_build(&f, context);
            CHECK(again != NULL);
            sps_tmap_destroy(again);
            sps_destroy(context);
            CHECK(hooks.live == 0 && hooks.live_blocks == 0);
            end(&f);
        }
}

/* A memory limit is an error until it is large enough, and is never exceeded. */
static void test_memory_limit(void) {
    for (int technique = SPS_TMAP_DEEP; technique <= TECHNIQUES; technique += 3) {
        int built = 0, refused = 0;
        for (size_t limit = 100000; !built; limit += limit / 4) {
            check_hooks hooks;
            sps_context *context;
            fixture f;
            sps_tmap *map;
            memset(&hooks, 0, sizeof hooks);
            hooks.memory_limit = limit;
            context = check_context(&hooks);
            begin_little(&f, technique);
            map = build(&f, context);
            if (map)
                ++built;
            else
                refused += strstr(sps_error(context), "memory_limit") != NULL;
            CHECK(hooks.peak <= limit);
            sps_tmap_destroy(map);
            sps_destroy(context);
            CHECK(hooks.live == 0);
            end(&f);
            if (!CHECK(limit < (size_t)1 << 30)) break;
        }
        CHECK(refused > 0);
    }
}

int main(void) {
    RUN(test_beer);
    RUN(test_same_bits);
    RUN(test_empty_soft_set);
    RUN(test_shuffled);
    RUN(test_bytes);
    RUN(test_bytes_of_half_empty_maps);
    RUN(test_budget_of_components);
    RUN(test_budget_of_lists);
    RUN(test_allocations);
    RUN(test_memory_limit);
    return check_report();
}
