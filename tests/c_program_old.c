/* A program that was compiled against an older header: its structures are the first fields of today's, as test_c.py cuts
 * them. It matches a texture by all that it knows, and forks; test_c.py looks at what comes out.
 */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "phasestereo.h"

enum { WIDTH = 96, HEIGHT = 64, SHIFT = 5, DISPARITIES = 16 };

static uint8_t left_pixels[HEIGHT][WIDTH], right_pixels[HEIGHT][WIDTH];

static uint8_t texture(int x, int y) {
    uint32_t hash = (uint32_t)x * 2654435761u + (uint32_t)y * 40503u;
    return (uint8_t)((hash ^ hash >> 15) * 2246822519u >> 24);
}

static int refused(phasestereo_matcher *matcher, const phasestereo_image *left, const phasestereo_image *right,
                   const phasestereo_map *map, phasestereo_found *found) {
    const phasestereo_status status = phasestereo_match(matcher, left, right, 0, DISPARITIES, map, found);
    printf("%d %s\n", status, phasestereo_error());
    return status == PHASESTEREO_STATUS_INVALID_ARGUMENT;
}

int main(void) {
    for (int y = 0; y < HEIGHT; y++) {
        for (int x = 0; x < WIDTH; x++) {
            left_pixels[y][x] = texture(x, y);
            right_pixels[y][x] = texture(x + SHIFT, y);
        }
    }
    phasestereo_image left = {sizeof left, left_pixels, WIDTH, WIDTH, HEIGHT, PHASESTEREO_GRAY, 8};
    phasestereo_image right = {sizeof right, right_pixels, WIDTH, WIDTH, HEIGHT, PHASESTEREO_GRAY, 8};

    /* Structures in memory that ends where they end: a sanitizer sees a byte too much. */
    float *disparity = malloc(WIDTH * HEIGHT * sizeof(float));
    phasestereo_map *map = malloc(sizeof *map);
    phasestereo_found *found = malloc(sizeof *found);
    phasestereo_matcher *matcher = phasestereo_new("fast", NULL, 0, 2);
    if (disparity == NULL || map == NULL || found == NULL || matcher == NULL) return 3;
    memset(map, 0, sizeof *map);
    map->struct_size = sizeof *map;
    map->disparity = disparity;
    map->disparity_stride = WIDTH * sizeof(float);
    found->struct_size = sizeof *found;

    if (phasestereo_match(matcher, &left, &right, 0, DISPARITIES, map, found) != PHASESTEREO_STATUS_OK) return 4;
    printf("sizes %zu %zu\n", found->struct_size, map->struct_size);
    printf("disparity %.0f\n", disparity[WIDTH * HEIGHT / 2 + WIDTH / 2]);

    /* What is not acceptable. */
    const ptrdiff_t strides[] = {0, WIDTH - 1, -1, PTRDIFF_MAX};
    for (size_t at = 0; at < sizeof strides / sizeof *strides; at++) {
        left.stride = strides[at];
        if (!refused(matcher, &left, &right, map, found)) return 5;
    }
    left.stride = WIDTH;
    map->disparity_stride = WIDTH;
    if (!refused(matcher, &left, &right, map, found)) return 6;
    map->disparity_stride = WIDTH * sizeof(float);
    found->struct_size = 0;
    if (!refused(matcher, &left, &right, map, found)) return 7;
    found->struct_size = sizeof *found;
    struct { phasestereo_image known; uint64_t mask[2], newer; } newer = {left, {0, 0}, 0};
    newer.known.struct_size = sizeof newer;
    if (phasestereo_match(matcher, &newer.known, &right, 0, DISPARITIES, map, found) != PHASESTEREO_STATUS_OK) return 8;
    newer.newer = 1;
    if (!refused(matcher, &newer.known, &right, map, found)) return 9;

    /* A child has none of the matcher's threads. */
    fflush(stdout);
    const pid_t child = fork();
    if (child == 0) {
        int failed = !refused(matcher, &left, &right, map, found);
        phasestereo_free(matcher);
        matcher = phasestereo_new("fast", NULL, 0, 2);
        failed |= phasestereo_match(matcher, &left, &right, 0, DISPARITIES, map, found) != PHASESTEREO_STATUS_OK;
        phasestereo_free(matcher);
        fflush(stdout);
        _exit(failed);
    }
    int status;
    if (child < 0 || waitpid(child, &status, 0) != child || status != 0) return 10;

    phasestereo_free(matcher);
    free(found);
    free(map);
    free(disparity);
    return 0;
}
