// What StereoPhase does beside matching, of Python's file IN.yml: stereo_phase IN.yml OUT.yml; see tests/core/test_cpp.py.

#include <cstdio>
#include <functional>

#include <phasestereo.hpp>

using phasestereo::StereoPhase;

static void refused(const std::function<void()> &call) {
    try {
        call();
        std::puts("taken");
    } catch (const cv::Exception &error) {
        std::printf("%d %s\n", error.code, error.err.c_str());
    }
}

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    // By the interface of the base class, and by OpenCV's own way to load.
    cv::Ptr<StereoPhase> stereo = cv::Algorithm::load<StereoPhase>(argv[1]);
    const cv::Ptr<cv::StereoMatcher> matcher = stereo;
    std::printf("%d %d %d %d %d\n", matcher->getMinDisparity(), matcher->getNumDisparities(), matcher->getBlockSize(),
                stereo->getUniquenessRatio(), stereo->getMode());

    cv::Mat left(60, 120, CV_16UC4), right(60, 120, CV_16UC4), disparity;
    cv::RNG(1).fill(left, cv::RNG::UNIFORM, 0, 65536);
    left.colRange(7, 120).copyTo(right.colRange(0, 113));
    cv::RNG(2).fill(right.colRange(113, 120), cv::RNG::UNIFORM, 0, 65536);
    matcher->compute(left, right, disparity);
    std::printf("middle %d\n", disparity.at<short>(30, 60));

    cv::UMat device;
    matcher->compute(left.getUMat(cv::ACCESS_READ), right.getUMat(cv::ACCESS_READ), device);
    std::printf("same %d\n", cv::countNonZero(device.getMat(cv::ACCESS_READ) != disparity) == 0);

    stereo->setP1(9);
    stereo->save(argv[2]);

    refused([] { StereoPhase::create(0, 0); });
    refused([] { StereoPhase::create(2000, 49); });
    refused([] { StereoPhase::create(0, 16, 0, 0, 0, 0, 0, 0, 0, 0, 0, "best"); });
    refused([] { StereoPhase::create(0, 16, 0, 0, 0, 0, 0, 0, 0, 0, 0, "fast", {{"window", "3"}}); });
    refused([] { StereoPhase::create(0, 16, 0, 0, 0, 0, 0, 0, 0, 0, 0, "fast", {{"median", "x"}}); });
    refused([&] { stereo->setMode(4); });
    refused([&] { matcher->compute(left, right.rowRange(0, 59), disparity); });
    refused([&] { matcher->compute(cv::Mat(9, 9, CV_32F), cv::Mat(9, 9, CV_32F), disparity); });
    refused([&] { StereoPhase::create(0, 200)->compute(left, right, disparity); });
    cv::FileStorage other("%YAML:1.0\nname: other\n", cv::FileStorage::READ | cv::FileStorage::MEMORY);
    refused([&] { stereo->read(other.root()); });
    return stereo->getP1() == 9 && stereo->getDefaultName() == "StereoPhase" ? 0 : 1;
}
