/* Registers depths to a third camera by the C interface; test_c.py looks at what comes out.
 *
 *     c_register FOLDER COLUMNS ROWS WIDTH HEIGHT FISHEYE
 *
 * FOLDER has depth, near, far, confidence as floats, and numbers: P1 and P2, the camera's matrix, 14 numbers of distortion,
 * rotation and translation, as doubles. What is written goes there, too.
 */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "c_files.h"
#include "phasestereo.h"

static void refused(phasestereo_status status) {
    printf("%s %s\n", status == PHASESTEREO_STATUS_INVALID_ARGUMENT ? "refused" : "taken", phasestereo_error());
}

int main(int count, char **words) {
    if (count != 7) return 2;
    folder = words[1];
    uint32_t cols = (uint32_t)atoi(words[2]), rows = (uint32_t)atoi(words[3]);

    double numbers[24 + 9 + 14 + 9 + 3];
    read_all("numbers", numbers, sizeof numbers);
    phasestereo_calibration rig;
    memset(&rig, 0, sizeof rig);
    rig.struct_size = sizeof rig;
    memcpy(rig.projection, numbers, sizeof rig.projection);
    phasestereo_camera camera;
    memset(&camera, 0, sizeof camera);
    camera.struct_size = sizeof camera;
    memcpy(camera.matrix, numbers + 24, sizeof camera.matrix);
    memcpy(camera.distortion, numbers + 33, sizeof camera.distortion);
    memcpy(camera.rotation, numbers + 47, sizeof camera.rotation);
    memcpy(camera.translation, numbers + 56, sizeof camera.translation);
    camera.width = (uint32_t)atoi(words[4]);
    camera.height = (uint32_t)atoi(words[5]);
    camera.fisheye = (uint32_t)atoi(words[6]);

    /* Rows with a gap of a value between them. */
    size_t stride = sizeof(float) * (cols + 1), size = sizeof(float) * cols;
    const char *names[] = {"depth", "near", "far", "confidence"};
    float *given[4];
    for (int at = 0; at < 4; at++) {
        float *map = room(size * rows);
        read_all(names[at], map, size * rows);
        given[at] = room(stride * rows);
        for (uint32_t y = 0; y < rows; y++) memcpy(given[at] + y * (cols + 1), map + y * cols, size);
        free(map);
    }
    phasestereo_depths depths = {sizeof depths, cols, rows, given[0], (ptrdiff_t)stride, given[1], given[2], given[3]};

    size_t pixels = (size_t)camera.width * camera.height;
    float *made[4];
    for (int at = 0; at < 4; at++) made[at] = room(sizeof(float) * pixels);
    int64_t *source = room(sizeof(int64_t) * pixels);
    uint8_t *holes = room(pixels), *occluded = room(pixels);
    ptrdiff_t row = (ptrdiff_t)camera.width;
    phasestereo_registered registered = {
        sizeof registered, made[0], 4 * row, made[1], made[2], made[3], source, 8 * row, holes, occluded, row};

    phasestereo_matcher *matcher = phasestereo_new("fast", NULL, 0, 2);
    if (phasestereo_register(matcher, &depths, &rig, &camera, &registered) != PHASESTEREO_STATUS_OK) {
        printf("error %s\n", phasestereo_error());
        return 1;
    }
    const char *outputs[] = {"r_depth", "r_near", "r_far", "r_confidence"};
    for (int at = 0; at < 4; at++) write_all(outputs[at], made[at], sizeof(float) * pixels);
    write_all("r_source", source, sizeof(int64_t) * pixels);
    write_all("r_holes", holes, pixels);
    write_all("r_occluded", occluded, pixels);

    /* Without bars and confidences there are none, and only what is wanted is written. */
    phasestereo_depths alone = {sizeof alone, cols, rows, given[0], (ptrdiff_t)stride, NULL, NULL, NULL};
    phasestereo_registered one = {sizeof one, NULL, 4 * row, made[1], NULL, NULL, NULL, 0, NULL, NULL, 0};
    if (phasestereo_register(matcher, &alone, &rig, &camera, &one) != PHASESTEREO_STATUS_OK) return 1;
    for (size_t at = 0; at < pixels; at++)
        if (!isnan(made[1][at])) return 7;

    phasestereo_camera none = camera;
    none.width = 0;
    refused(phasestereo_register(matcher, &depths, &rig, &none, &registered));
    phasestereo_calibration near_each_other = rig;
    near_each_other.projection[1][0][3] = 0;
    refused(phasestereo_register(matcher, &depths, &near_each_other, &camera, &registered));
    depths.depth = NULL;
    refused(phasestereo_register(matcher, &depths, &rig, &camera, &registered));

    phasestereo_free(matcher);
    for (int at = 0; at < 4; at++) {
        free(given[at]);
        free(made[at]);
    }
    free(source);
    free(holes);
    free(occluded);
    return 0;
}
