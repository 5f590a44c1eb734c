/* Prepares a pair for another matcher, and brings a map back, by the C interface; test_c.py looks at what comes out.
 *
 *     c_prepare FOLDER WIDTH HEIGHT CHANNELS MOST
 *
 * FOLDER has left and right as raw pixels of 8 bits; what is written goes there, too.
 */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "c_files.h"
#include "phasestereo.h"

static void done(phasestereo_status status) {
    if (status == PHASESTEREO_STATUS_OK) return;
    printf("error %s\n", phasestereo_error());
    exit(1);
}

int main(int count, char **words) {
    if (count != 6) return 2;
    folder = words[1];
    uint32_t width = (uint32_t)atoi(words[2]), height = (uint32_t)atoi(words[3]);
    uint32_t channels = (uint32_t)atoi(words[4]), most = (uint32_t)atoi(words[5]);
    size_t row = (size_t)width * (channels == PHASESTEREO_GRAY ? 1 : 3);

    phasestereo_image images[2];
    memset(images, 0, sizeof images);
    for (int side = 0; side < 2; side++) {
        void *data = room(row * height);
        read_all(side ? "right" : "left", data, row * height);
        phasestereo_image image = {sizeof image, data, (ptrdiff_t)row, width, height, channels, 8, NULL, 0};
        images[side] = image;
    }

    phasestereo_matcher *matcher = phasestereo_new("robust", NULL, 0, 2);
    phasestereo_prepared *pair = phasestereo_prepare(matcher, &images[0], &images[1], 0, 0, most);
    free((void *)images[0].data);
    free((void *)images[1].data);
    phasestereo_free(matcher);
    if (pair == NULL) {
        printf("error %s\n", phasestereo_error());
        return 1;
    }

    const char *text;
    for (uint32_t at = 0; (text = phasestereo_prepared_done(pair, at)) != NULL; at++) printf("done %s\n", text);
    printf("disparities %u\n", phasestereo_prepared_disparities(pair));

    phasestereo_image seen = {sizeof seen, NULL, 0, 0, 0, 0, 0, NULL, 0};
    for (uint32_t side = 0; side < 2; side++) {
        done(phasestereo_prepared_image(pair, side, &seen));
        write_all(side ? "prepared_right" : "prepared_left", seen.data, (size_t)seen.stride * seen.height);
    }
    printf("size %u %u %u %u\n", seen.height, seen.width, seen.channels, seen.bits);

    /* A map with a gap of a value between its rows. */
    size_t stride = sizeof(float) * (seen.width + 1);
    float *map = room(stride * seen.height), *restored = room(sizeof(float) * width * height);
    for (uint32_t y = 0; y < seen.height; y++)
        for (uint32_t x = 0; x < seen.width; x++) map[y * (seen.width + 1) + x] = 3.0f + 0.01f * (float)x;
    done(phasestereo_restore(pair, map, (ptrdiff_t)stride, seen.width, seen.height, restored,
                             (ptrdiff_t)(sizeof(float) * width)));
    write_all("restored", restored, sizeof(float) * width * height);

    if (phasestereo_restore(pair, map, (ptrdiff_t)stride, 9, 3, restored, (ptrdiff_t)(sizeof(float) * width))
        == PHASESTEREO_STATUS_INVALID_ARGUMENT)
        printf("refused %s\n", phasestereo_error());
    if (phasestereo_prepared_image(pair, 2, &seen) == PHASESTEREO_STATUS_INVALID_ARGUMENT)
        printf("refused %s\n", phasestereo_error());
    phasestereo_prepared_free(pair);
    phasestereo_prepared_free(NULL);
    free(map);
    free(restored);
    return 0;
}
