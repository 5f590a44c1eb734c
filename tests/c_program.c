/* Matches raw images in all the ways of the C interface; test_c.py looks at what comes out.
 *
 *     c_program LEFT RIGHT WIDTH HEIGHT CHANNELS BITS STRIDE PRESET DISPARITIES OUTPUT [right]
 */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "phasestereo.h"

static void *room(size_t bytes) {
    void *memory = malloc(bytes);
    if (memory == NULL) exit(3);
    return memory;
}

static void *read_all(const char *path, size_t bytes) {
    FILE *file = fopen(path, "rb");
    void *data = room(bytes);
    if (file == NULL || fread(data, 1, bytes, file) != bytes) exit(3);
    fclose(file);
    return data;
}

static void tell(const phasestereo_found *found) {
    printf("range %d %d %u\n", found->min_disparity, found->num_disparities, found->origin);
    if (found->num_blurs > 0) {
        printf("blur %u %u %.17g %.17g\n", found->blurs[0].side, found->blurs[0].kind, found->blurs[0].size,
               found->certainty);
        printf("noise %.17g %.17g\n", found->noise[0], found->noise[1]);
    }
    printf("vertical %u\n", found->vertical);
    if (found->rows_blocks > 0) printf("rows %.17g %u\n", found->rows[0], found->rows_applied);
}

static void tell_findings(const char *call) {
    static const char *const severities[] = {"ok", "note", "warning"};
    phasestereo_finding finding = {sizeof finding, NULL, NULL, 0};
    for (uint32_t at = 0; phasestereo_get_finding(at, &finding) == 1; at++) {
        printf("%s %s|%s|%s\n", call, finding.topic, severities[finding.severity], finding.sentence);
    }
}

int main(int count, char **arguments) {
    if (count != 11 && count != 12) return 3;
    const uint32_t width = (uint32_t)atoi(arguments[3]), height = (uint32_t)atoi(arguments[4]);
    const uint32_t channels = (uint32_t)atoi(arguments[5]), bits = (uint32_t)atoi(arguments[6]);
    const ptrdiff_t stride = atoi(arguments[7]);
    const int disparities = atoi(arguments[9]);
    const size_t bytes = (size_t)labs((long)stride) * height, pixels = (size_t)width * height;

    /* With a negative stride the first row is the last one in memory. */
    static char *left_data, *right_data; /* where a sanitizer finds them if the program ends early */
    left_data = (char *)read_all(arguments[1], bytes);
    right_data = (char *)read_all(arguments[2], bytes);
    const size_t first = stride < 0 ? bytes + stride : 0;
    phasestereo_image left = {sizeof left, left_data + first, stride, width, height, channels, bits, NULL, 0};
    phasestereo_image right = {sizeof right, right_data + first, stride, width, height, channels, bits, NULL, 0};

    const phasestereo_setting settings[] = {{"median", "0"}, {"min_confidence", " 0.25 "}, {"lr_check", "none"}};
    const phasestereo_setting vertical[] = {{"vertical", "true"}};
    const int is_settings = strcmp(arguments[8], "settings") == 0, is_vertical = strcmp(arguments[8], "vertical") == 0;
    const uint32_t keep = strcmp(arguments[8], "trusted") == 0   ? PHASESTEREO_TRUSTED
                          : strcmp(arguments[8], "checked") == 0 ? PHASESTEREO_CHECKED
                          : strcmp(arguments[8], "sure") == 0    ? PHASESTEREO_CHECKED + 1
                                                                 : PHASESTEREO_ALL;
    phasestereo_matcher *matcher = is_settings   ? phasestereo_new(NULL, settings, 3, 2)
                                   : is_vertical ? phasestereo_new("fast", vertical, 1, 2)
                                                 : keep != 0   ? phasestereo_new("robust", NULL, 0, 2)
                                                 : phasestereo_new(arguments[8], NULL, 0, 2);
    if (matcher == NULL) {
        printf("%s\n", phasestereo_error());
        return 1;
    }

    static float *planes;
    static uint16_t *flags;
    planes = (float *)room(3 * pixels * sizeof(float));
    flags = (uint16_t *)room(pixels * sizeof(uint16_t));
    const ptrdiff_t row = (ptrdiff_t)(width * sizeof(float));
    const phasestereo_map map = {sizeof map, planes, row, flags, row / 2, planes + pixels, row, planes + 2 * pixels, row, NULL, 0, keep};
    phasestereo_found found, checked;
    found.struct_size = checked.struct_size = sizeof found;
    phasestereo_status (*const match)(const phasestereo_matcher *, const phasestereo_image *, const phasestereo_image *,
                                      int32_t, int32_t, const phasestereo_map *, phasestereo_found *) =
        count == 12 ? phasestereo_match_right : phasestereo_match;
    phasestereo_status status = match(matcher, &left, &right, 0, disparities, &map, &found);
    if (status != PHASESTEREO_STATUS_OK) {
        printf("%d %s\n", status, phasestereo_error());
        phasestereo_free(matcher);
        return 1;
    }
    tell_findings("matched");

    /* What a check finds is what the match has found; and a map that nobody wants is not written. */
    const phasestereo_map nothing = {sizeof nothing, NULL, 0, NULL, 0, NULL, 0, NULL, 0, NULL, 0, 0};
    if (phasestereo_check(matcher, &left, &right, 0, disparities, &checked) != PHASESTEREO_STATUS_OK) return 3;
    if (checked.num_disparities != found.num_disparities) return 3;
    tell_findings("checked");
    if (phasestereo_match(matcher, &left, &right, 0, disparities, &nothing, NULL) != PHASESTEREO_STATUS_OK) return 3;

    printf("version %s\nthreads %u\n", phasestereo_version(), phasestereo_threads(matcher));
    printf("memory %llu\n", (unsigned long long)phasestereo_memory(matcher, width, height, 3, found.num_disparities));
    tell(&found);
    FILE *file = fopen(arguments[10], "wb");
    if (file == NULL) return 3;
    fwrite(planes, sizeof(float), 3 * pixels, file);
    fwrite(flags, sizeof(uint16_t), pixels, file);
    fclose(file);

    phasestereo_free(matcher);
    phasestereo_free(NULL);
    free(planes);
    free(flags);
    free(left_data);
    free(right_data);
    return 0;
}
