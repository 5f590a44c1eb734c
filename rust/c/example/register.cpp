// Depths of a stereo pair in the frame of a color camera beside it: a wall, and a box before it.

#include <cmath>
#include <cstdio>
#include <vector>

#include "phasestereo.h"

int main() {
    const uint32_t width = 160, height = 120;
    const double focal = 200, baseline = 0.05;  // pixels, m

    std::vector<float> depth(width * height);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            depth[y * width + x] = x >= 60 && x < 100 && y >= 40 && y < 80 ? 1.0f : 2.0f;

    phasestereo_calibration rig = {};
    rig.struct_size = sizeof rig;
    for (int side = 0; side < 2; side++) {
        const double rows[3][4] = {{focal, 0, 79.5, side ? -focal * baseline : 0}, {0, focal, 59.5, 0}, {0, 0, 1, 0}};
        for (int row = 0; row < 3; row++)
            for (int column = 0; column < 4; column++) rig.projection[side][row][column] = rows[row][column];
    }

    phasestereo_camera color = {};
    color.struct_size = sizeof color;
    color.matrix[0][0] = color.matrix[1][1] = 400;
    color.matrix[0][2] = 159.5;
    color.matrix[1][2] = 119.5;
    color.matrix[2][2] = 1;
    for (int axis = 0; axis < 3; axis++) color.rotation[axis][axis] = 1;
    color.translation[0] = -0.1;  // it stands 10 cm to the right
    color.width = 320;
    color.height = 240;

    phasestereo_depths depths = {};
    depths.struct_size = sizeof depths;
    depths.width = width;
    depths.height = height;
    depths.depth = depth.data();
    depths.stride = sizeof(float) * width;

    std::vector<float> seen(color.width * color.height);
    std::vector<uint8_t> occluded(seen.size());
    phasestereo_registered registered = {};
    registered.struct_size = sizeof registered;
    registered.depth = seen.data();
    registered.stride = sizeof(float) * color.width;
    registered.occluded = occluded.data();
    registered.flags_stride = color.width;

    phasestereo_matcher *matcher = phasestereo_new("fast", nullptr, 0, 0);
    const phasestereo_status status = phasestereo_register(matcher, &depths, &rig, &color, &registered);
    phasestereo_free(matcher);
    if (status != PHASESTEREO_STATUS_OK) {
        std::fprintf(stderr, "%s\n", phasestereo_error());
        return 1;
    }

    // The box of 20 cm is 80 pixels wide for the color camera, and hides as much of the wall as its view differs.
    const float *row = &seen[120 * color.width];
    uint32_t near = 0, hidden = 0;
    for (uint32_t x = 0; x < color.width; x++) {
        near += row[x] == 1.0f;
        hidden += occluded[120 * color.width + x];
    }
    std::printf("box %u pixels wide, %u behind it\n", near, hidden);
    return 0;
}
