// Matches a texture with itself, some columns further left, and prints what is found: no library but phasestereo.

#include <cstdint>
#include <cstdio>
#include <memory>
#include <vector>

#include "phasestereo.h"

namespace {

constexpr uint32_t WIDTH = 160, HEIGHT = 120, SHIFT = 7;

using Matcher = std::unique_ptr<phasestereo_matcher, decltype(&phasestereo_free)>;

std::vector<uint8_t> texture(uint32_t shift) {
    std::vector<uint8_t> pixels(WIDTH * HEIGHT);
    for (uint32_t at = 0; at < pixels.size(); at++) {
        const uint32_t hash = (at % WIDTH + shift) * 2654435761u + at / WIDTH * 40503u;
        pixels[at] = static_cast<uint8_t>((hash ^ hash >> 15) * 2246822519u >> 24);
    }
    return pixels;
}

// A view of the pixels, which must live as long: nothing is copied here. Fields that are not named are zero.
phasestereo_image view(const std::vector<uint8_t> &pixels) {
    phasestereo_image viewed = {};
    viewed.struct_size = sizeof viewed;
    viewed.data = pixels.data();
    viewed.stride = WIDTH;
    viewed.width = WIDTH;
    viewed.height = HEIGHT;
    viewed.channels = PHASESTEREO_GRAY;
    viewed.bits = 8;
    return viewed;
}

}  // namespace

int main() {
    const std::vector<uint8_t> left = texture(0), right = texture(SHIFT);
    const phasestereo_image views[] = {view(left), view(right)};

    std::vector<float> disparity(left.size());
    phasestereo_map map = {};
    map.struct_size = sizeof map;
    map.disparity = disparity.data();
    map.disparity_stride = WIDTH * sizeof(float);

    const Matcher matcher(phasestereo_new("robust", nullptr, 0, 0), phasestereo_free);
    if (!matcher || phasestereo_match(matcher.get(), &views[0], &views[1], 0, 32, &map, nullptr) != PHASESTEREO_STATUS_OK) {
        std::fprintf(stderr, "%s\n", phasestereo_error());
        return 1;
    }

    phasestereo_finding finding = {};
    finding.struct_size = sizeof finding;
    for (uint32_t at = 0; phasestereo_get_finding(at, &finding) == 1; at++) std::printf("%s: %s\n", finding.topic, finding.sentence);
    std::printf("disparity %.0f\n", static_cast<double>(disparity[HEIGHT / 2 * WIDTH + WIDTH / 2]));
}
