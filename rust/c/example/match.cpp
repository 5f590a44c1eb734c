// Matches two rectified photographs with OpenCV's images: match LEFT RIGHT DISPARITY.tiff [NUM_DISPARITIES]

#include <cstdio>
#include <cstdlib>
#include <memory>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "phasestereo.h"

namespace {

using Matcher = std::unique_ptr<phasestereo_matcher, decltype(&phasestereo_free)>;

// A view of an image, which must live as long: nothing is copied here.
phasestereo_image view(const cv::Mat &image) {
    phasestereo_image viewed = {};
    viewed.struct_size = sizeof viewed;
    viewed.data = image.data;
    viewed.stride = static_cast<ptrdiff_t>(image.step);
    viewed.width = static_cast<uint32_t>(image.cols);
    viewed.height = static_cast<uint32_t>(image.rows);
    viewed.channels = image.channels() == 1 ? PHASESTEREO_GRAY : PHASESTEREO_BGR;
    viewed.bits = image.depth() == CV_16U ? 16 : 8;
    return viewed;
}

int fail(const char *message) {
    std::fprintf(stderr, "%s\n", message);
    return 1;
}

}  // namespace

int main(int count, char **arguments) {
    if (count < 4) return fail("match LEFT RIGHT DISPARITY.tiff [NUM_DISPARITIES]");
    const cv::Mat left = cv::imread(arguments[1], cv::IMREAD_ANYCOLOR | cv::IMREAD_ANYDEPTH);
    const cv::Mat right = cv::imread(arguments[2], cv::IMREAD_ANYCOLOR | cv::IMREAD_ANYDEPTH);
    if (left.empty() || right.empty()) return fail("an image could not be read");
    const int num_disparities = count > 4 ? std::atoi(arguments[4]) : 0;  // 0: they are found

    // One matcher for all pairs: it keeps its threads and its memory.
    const Matcher matcher(phasestereo_new("robust", nullptr, 0, 0), phasestereo_free);
    if (!matcher) return fail(phasestereo_error());

    cv::Mat disparity(left.size(), CV_32F);
    phasestereo_map map = {};
    map.struct_size = sizeof map;
    map.disparity = disparity.ptr<float>();
    map.disparity_stride = static_cast<ptrdiff_t>(disparity.step);

    const phasestereo_image views[] = {view(left), view(right)};
    phasestereo_found found = {};
    found.struct_size = sizeof found;
    if (phasestereo_match(matcher.get(), &views[0], &views[1], 0, num_disparities, &map, &found) != PHASESTEREO_STATUS_OK) {
        return fail(phasestereo_error());
    }

    std::printf("disparities %d to %d\n", found.min_disparity, found.min_disparity + found.num_disparities - 1);
    return cv::imwrite(arguments[3], disparity) ? 0 : fail("the map could not be written");
}
