/* Rectifies raw images, and matches frames of a rig, by the C interface; test_c.py looks at what comes out.
 *
 *     c_rig rectify FOLDER WIDTH HEIGHT CHANNELS BITS INTERPOLATION RIGHT_WIDTH RIGHT_HEIGHT
 *     c_rig frames FOLDER WIDTH HEIGHT
 *     c_rig refuse FOLDER WIDTH HEIGHT
 *
 * FOLDER has images as raw pixels without gaps; what is written goes there, too.
 */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "c_files.h"
#include "phasestereo.h"

enum { FRAMES = 3, DISPARITIES = 48, GAP = 5 };

static uint32_t width, height;

static char *read_text(const char *name) {
    FILE *file = opened(name, "rb");
    char *text = room(1 << 16);
    if (fread(text, 1, (1 << 16) - 1, file) == 0) exit(5);
    fclose(file);
    return text;
}

static void done(phasestereo_status status) {
    if (status == PHASESTEREO_STATUS_OK) return;
    printf("%d %s\n", status, phasestereo_error());
    fflush(stdout);
    _exit(7);
}

static void refused(phasestereo_status status) {
    printf("%d %s\n", status, phasestereo_error());
    if (status != PHASESTEREO_STATUS_INVALID_ARGUMENT) exit(8);
}

static phasestereo_image image_of(const char *name, uint32_t cols, uint32_t rows, uint32_t channels, uint32_t bits) {
    const uint32_t counts[] = {1, 3, 4, 3, 4};
    const size_t row = (size_t)cols * counts[channels] * bits / 8;
    void *data = room(row * rows);
    read_all(name, data, row * rows);
    phasestereo_image made = {sizeof made, data, (ptrdiff_t)row, cols, rows, channels, bits, NULL, 0};
    return made;
}

static phasestereo_image image(const char *name, uint32_t channels, uint32_t bits) {
    return image_of(name, width, height, channels, bits);
}

/* Rows of what is written are some bytes apart, and upside down: what lies between them stays as it is. */
static void rectify(phasestereo_matcher *matcher, uint32_t channels, uint32_t bits, uint32_t interpolation, uint32_t right_width,
                    uint32_t right_height) {
    const phasestereo_image left = image("left", channels, bits);
    const phasestereo_image right = image_of("right", right_width, right_height, channels, bits);
    phasestereo_calibration calibration;
    memset(&calibration, 0, sizeof calibration);
    calibration.struct_size = sizeof calibration;

    double given[54]; /* K1, K2, D1, D2, R, T; K1 is 0: not known */
    read_all("calibration", given, sizeof given);
    if (given[0] == 0) {
        done(phasestereo_estimate_calibration(matcher, &left, &right, &calibration));
        phasestereo_finding finding = {sizeof finding, NULL, NULL, 0};
        for (uint32_t at = 0; phasestereo_get_finding(at, &finding) == 1; at++) puts(finding.sentence);
    } else {
        memcpy(calibration.camera, given, sizeof calibration.camera);
        memcpy(calibration.distortion, given + 18, sizeof calibration.distortion);
        done(phasestereo_stereo_rectify(&calibration, given + 42, given + 51, width, height, right_width, right_height));
    }

    const ptrdiff_t stride = left.stride + GAP, mask_stride = (ptrdiff_t)width + GAP;
    const size_t bytes = stride * height, mask_bytes = mask_stride * height;
    char *pixels = room(2 * bytes);
    uint8_t *masks = room(2 * mask_bytes);
    phasestereo_rectified rectified = {
        sizeof rectified, {pixels, pixels + bytes + bytes - stride}, {stride, -stride},
        {masks, masks + mask_bytes}, {mask_stride, mask_stride}, {{0}},
    };
    done(phasestereo_rectify(matcher, &left, &right, &calibration, interpolation, &rectified));

    write_all("pixels", pixels, 2 * bytes);
    write_all("masks", masks, 2 * mask_bytes);
    write_all("q", rectified.q, sizeof rectified.q);
    write_all("projection", calibration.projection, sizeof calibration.projection);

    /* And match what was written, by its masks: what is not valid has no disparity. */
    phasestereo_image views[] = {left, right};
    views[0].data = rectified.image[0];
    views[0].mask = rectified.mask[0];
    views[1].data = rectified.image[1];
    views[1].width = width;
    views[1].height = height;
    views[1].mask = rectified.mask[1];
    views[0].stride = stride;
    views[1].stride = -stride;
    views[0].mask_stride = views[1].mask_stride = mask_stride;
    float *disparity = room(sizeof(float) * width * height);
    phasestereo_map map = {sizeof map, disparity, (ptrdiff_t)(sizeof(float) * width), NULL, 0, NULL, 0, NULL, 0, NULL, 0, 0};
    done(phasestereo_match(matcher, &views[0], &views[1], 0, 16, &map, NULL));
    write_all("disparity", disparity, sizeof(float) * width * height);

    free(disparity);
    free(masks);
    free(pixels);
    free((void *)left.data);
    free((void *)right.data);
}

static phasestereo_map map_of(float *disparity, uint8_t *support) {
    phasestereo_map map = {sizeof map, disparity, (ptrdiff_t)(sizeof(float) * width), NULL, 0, NULL, 0, NULL, 0, support, width, 0};
    return map;
}

static char *text_of(const phasestereo_rig *rig) {
    const size_t bytes = phasestereo_rig_text(rig, NULL, 0);
    char *text = room(bytes);
    if (phasestereo_rig_text(rig, text, bytes - 1) != bytes || text[0] != 0) exit(9); /* too little room: not written */
    if (phasestereo_rig_text(rig, text, bytes) != bytes || strlen(text) + 1 != bytes) exit(9);
    return text;
}

/* The frames twice: the second time by a rig that was reset. Then the last of them by a rig that was saved after the others. */
static void frames(phasestereo_matcher *matcher) {
    const size_t pixels = (size_t)width * height;
    float *disparity = room(sizeof(float) * pixels);
    uint8_t *support = room(pixels);
    const phasestereo_map map = map_of(disparity, support);
    phasestereo_rig *rig = phasestereo_rig_new(NULL, 1, 0);
    if (rig == NULL) exit(10);

    for (int round = 0; round < 2; round++) {
        FILE *file = opened(round == 0 ? "first" : "again", "wb");
        for (int frame = 0; frame < FRAMES; frame++) {
            char names[2][16];
            snprintf(names[0], 16, "left%d", frame);
            snprintf(names[1], 16, "right%d", frame);
            const phasestereo_image left = image(names[0], PHASESTEREO_RGB, 8), right = image(names[1], PHASESTEREO_RGB, 8);
            if (round == 1 && frame == FRAMES - 1) {
                char *text = text_of(rig);
                write_all("text", text, strlen(text));
                phasestereo_rig *loaded = phasestereo_rig_new(text, 0, 0);
                if (loaded == NULL) exit(11);
                done(phasestereo_rig_match(loaded, matcher, &left, &right, 0, 0, &map, NULL));
                write_all("loaded", disparity, sizeof(float) * pixels);
                phasestereo_rig_free(loaded);
                free(text);
            }
            done(phasestereo_rig_match(rig, matcher, &left, &right, 0, 0, &map, NULL));
            fwrite(disparity, sizeof(float), pixels, file);
            fwrite(support, 1, pixels, file);
            free((void *)left.data);
            free((void *)right.data);
        }
        fclose(file);
        if (round == 0) done(phasestereo_rig_reset(rig));
    }

    phasestereo_rig_free(rig);
    free(support);
    free(disparity);
}

static void refuse(phasestereo_matcher *matcher) {
    phasestereo_image left = image("left", PHASESTEREO_GRAY, 8), right = left;
    float *disparity = room(sizeof(float) * width * height);
    const phasestereo_map map = map_of(disparity, NULL);
    phasestereo_rig *rig = phasestereo_rig_new(NULL, 0, 0);
    done(phasestereo_rig_match(rig, matcher, &left, &right, 0, 16, &map, NULL));
    phasestereo_calibration calibration;
    double given[54];
    read_all("calibration", given, sizeof given);
    memset(&calibration, 0, sizeof calibration);
    memcpy(calibration.camera, given, sizeof calibration.camera);
    const double *rotation = given + 42;
    double translation[] = {0.001, -0.12, 0};

    refused(phasestereo_stereo_rectify(NULL, rotation, given + 51, width, height, width, height));
    refused(phasestereo_stereo_rectify(&calibration, rotation, given + 51, width, height, width, height));
    calibration.struct_size = sizeof calibration;
    refused(phasestereo_stereo_rectify(&calibration, NULL, given + 51, width, height, width, height));
    refused(phasestereo_stereo_rectify(&calibration, rotation, translation, width, height, width, height));
    refused(phasestereo_stereo_rectify(&calibration, given, given + 51, width, height, width, height));
    done(phasestereo_stereo_rectify(&calibration, rotation, given + 51, width, height, width, height));

    uint8_t *pixels = room(width * height);
    phasestereo_rectified rectified = {sizeof rectified, {NULL, NULL}, {0, 0}, {pixels, NULL}, {width - 1, 0}, {{0}}};
    refused(phasestereo_rectify(matcher, &left, &right, &calibration, 0, &rectified));
    rectified.mask_stride[0] = width;
    refused(phasestereo_rectify(matcher, &left, &right, &calibration, 2, &rectified));
    refused(phasestereo_rectify(matcher, &left, &right, NULL, 0, &rectified));
    refused(phasestereo_rectify(NULL, &left, &right, &calibration, 0, &rectified));
    refused(phasestereo_rectify(matcher, &left, &right, &calibration, 0, NULL));
    right.height /= 9;
    refused(phasestereo_rectify(matcher, &left, &right, &calibration, 0, &rectified));
    right.height = height;
    left.mask = pixels;
    refused(phasestereo_rectify(matcher, &left, &right, &calibration, 0, &rectified));
    left.mask = NULL;
    calibration.camera[1][1][1] = NAN;
    refused(phasestereo_rectify(matcher, &left, &right, &calibration, 0, &rectified));
    refused(phasestereo_estimate_calibration(matcher, &left, &right, &calibration)); /* it has no texture */

    refused(phasestereo_rig_match(NULL, matcher, &left, &right, 0, 16, &map, NULL));
    refused(phasestereo_rig_reset(NULL));
    char *text = text_of(rig);
    if (phasestereo_rig_text(NULL, NULL, 0) != 0 || phasestereo_rig_text(rig, NULL, 1 << 20) != 0) exit(12);
    puts(phasestereo_error());
    *strstr(text, "\"frames\"") = 'x';
    if (phasestereo_rig_new(text, 0, 0) != NULL) exit(13);
    puts(phasestereo_error());
    if (phasestereo_rig_new("\xff", 0, 0) != NULL) exit(14);
    puts(phasestereo_error());

    /* A child has none of the matcher's threads; the rig has none. */
    fflush(stdout);
    char *raw = read_text("raw");
    phasestereo_rig *rectifying = phasestereo_rig_new(raw, 0, 0);
    if (rectifying == NULL) exit(16);
    phasestereo_rig_free(rectifying);
    const pid_t child = fork();
    if (child == 0) {
        alarm(120);
        rectifying = phasestereo_rig_new(raw, 0, 0);
        if (rectifying == NULL) _exit(17);
        phasestereo_rig_free(rectifying);
        refused(phasestereo_rig_match(rig, matcher, &left, &right, 0, 16, &map, NULL));
        refused(phasestereo_rectify(matcher, &left, &right, &calibration, 0, &rectified));
        phasestereo_matcher *own = phasestereo_new("fast", NULL, 0, 1);
        done(phasestereo_rig_match(rig, own, &left, &right, 0, 16, &map, NULL));
        phasestereo_free(own);
        phasestereo_rig_free(rig);
        fflush(stdout);
        _exit(0);
    }
    int status;
    if (child < 0 || waitpid(child, &status, 0) != child || status != 0) exit(15);

    phasestereo_rig_free(rig);
    phasestereo_rig_free(NULL);
    free(raw);
    free(text);
    free(pixels);
    free(disparity);
    free((void *)left.data);
}

int main(int count, char **arguments) {
    if (count < 5) return 3;
    folder = arguments[2];
    width = (uint32_t)atoi(arguments[3]);
    height = (uint32_t)atoi(arguments[4]);
    phasestereo_matcher *matcher = phasestereo_new("fast", NULL, 0, 2);
    if (matcher == NULL) return 3;

    if (strcmp(arguments[1], "rectify") == 0 && count == 10) {
        rectify(matcher, (uint32_t)atoi(arguments[5]), (uint32_t)atoi(arguments[6]), (uint32_t)atoi(arguments[7]),
                (uint32_t)atoi(arguments[8]), (uint32_t)atoi(arguments[9]));
    } else if (strcmp(arguments[1], "frames") == 0) {
        frames(matcher);
    } else {
        refuse(matcher);
    }

    phasestereo_free(matcher);
    return 0;
}
