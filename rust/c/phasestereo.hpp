/* phasestereo in the place of OpenCV's matchers: a cv::StereoMatcher. OpenCV 4 and 5, C++11; see docs/c.md.
 *
 *     cv::Ptr<phasestereo::StereoPhase> stereo = phasestereo::StereoPhase::create(0, 64);
 *     stereo->compute(left, right, disparity);  // CV_16S, 16 = 1 px, (minDisparity - 1) * 16: none
 */

#ifndef PHASESTEREO_HPP
#define PHASESTEREO_HPP

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/core/version.hpp>
#if CV_VERSION_MAJOR >= 5
#include <opencv2/stereo.hpp>
#else
#include <opencv2/calib3d.hpp>
#endif

#include "phasestereo.h"

namespace phasestereo {

/** Settings by name, as text, such as {"median", "0"} or {"fill", "true"}; they take the place of the preset's. */
using Settings = std::map<std::string, std::string>;

/**
 * A matcher with the methods of cv::StereoSGBM.
 *
 * It keeps its threads and its memory from one pair to the next. While parameters are set or read, no other thread may use
 * it. What it refuses is a cv::Exception that names the parameter, what it got and what it accepts.
 */
class StereoPhase : public cv::StereoMatcher {
public:
    /**
     * Makes a matcher; the first eleven parameters are those of cv::StereoSGBM::create.
     *
     * minDisparity is -2047 to 2047, numDisparities any number up to the images' width, blockSize the side of the window, 0
     * being that of the preset. P1, P2, preFilterCap and mode are kept and change no disparity. threads 0: all
     * processors. Settings that the parameters decide (window, lr_check, uniqueness, speckle_size, speckle_range) are
     * refused.
     */
    static cv::Ptr<StereoPhase> create(int minDisparity = 0, int numDisparities = 16, int blockSize = 0, int P1 = 0,
                                       int P2 = 0, int disp12MaxDiff = 0, int preFilterCap = 0, int uniquenessRatio = 0,
                                       int speckleWindowSize = 0, int speckleRange = 0, int mode = 0,
                                       const std::string &preset = "robust", const Settings &settings = Settings(),
                                       int threads = 0) {
        const int values[] = {minDisparity,    numDisparities,    blockSize,    P1,  P2, disp12MaxDiff, preFilterCap,
                              uniquenessRatio, speckleWindowSize, speckleRange, mode};
        return cv::Ptr<StereoPhase>(new StereoPhase(values, preset, settings, threads));
    }

    /**
     * Matches a rectified pair of equal size and type: 8 or 16 bits, gray, BGR or BGRA.
     *
     * disparity becomes CV_16S in sixteenths of a pixel: left pixel (x, y) corresponds to right pixel (x - d / 16, y).
     * (minDisparity - 1) * 16: no estimate.
     */
    void compute(cv::InputArray left, cv::InputArray right, cv::OutputArray disparity) override {
        const cv::Mat images[] = {left.getMat(), right.getMat()};
        checkPair(images[0], images[1]);

        cv::Mat pixels(images[0].size(), CV_32F);
        phasestereo_map map = phasestereo_map();
        map.struct_size = sizeof map;
        map.disparity = pixels.ptr<float>();
        map.disparity_stride = static_cast<std::ptrdiff_t>(pixels.step);
        const phasestereo_image views[] = {view(images[0]), view(images[1])};
        const std::shared_ptr<phasestereo_matcher> matcher = current();
        check(phasestereo_match(matcher.get(), &views[0], &views[1], values_[MIN_DISPARITY], values_[NUM_DISPARITIES], &map,
                                nullptr) == PHASESTEREO_STATUS_OK);

        disparity.create(pixels.size(), CV_16S);
        cv::Mat sixteenths = disparity.getMat();
        for (int y = 0; y < pixels.rows; y++) {
            const float *from = pixels.ptr<float>(y);
            short *to = sixteenths.ptr<short>(y);
            for (int x = 0; x < pixels.cols; x++) to[x] = rounded(from[x], x, pixels.cols);
        }
    }

    int getMinDisparity() const override { return values_[MIN_DISPARITY]; }
    void setMinDisparity(int minDisparity) override { set(MIN_DISPARITY, minDisparity); }
    int getNumDisparities() const override { return values_[NUM_DISPARITIES]; }
    void setNumDisparities(int numDisparities) override { set(NUM_DISPARITIES, numDisparities); }
    int getBlockSize() const override { return values_[BLOCK_SIZE]; }
    void setBlockSize(int blockSize) override { set(BLOCK_SIZE, blockSize); }
    int getSpeckleWindowSize() const override { return values_[SPECKLE_WINDOW_SIZE]; }
    void setSpeckleWindowSize(int speckleWindowSize) override { set(SPECKLE_WINDOW_SIZE, speckleWindowSize); }
    int getSpeckleRange() const override { return values_[SPECKLE_RANGE]; }
    void setSpeckleRange(int speckleRange) override { set(SPECKLE_RANGE, speckleRange); }
    int getDisp12MaxDiff() const override { return values_[DISP12_MAX_DIFF]; }
    void setDisp12MaxDiff(int disp12MaxDiff) override { set(DISP12_MAX_DIFF, disp12MaxDiff); }

    /* As of cv::StereoSGBM. */
    int getUniquenessRatio() const { return values_[UNIQUENESS_RATIO]; }
    void setUniquenessRatio(int uniquenessRatio) { set(UNIQUENESS_RATIO, uniquenessRatio); }
    int getPreFilterCap() const { return values_[PRE_FILTER_CAP]; }
    void setPreFilterCap(int preFilterCap) { set(PRE_FILTER_CAP, preFilterCap); }
    int getP1() const { return values_[P1]; }
    void setP1(int value) { set(P1, value); }
    int getP2() const { return values_[P2]; }
    void setP2(int value) { set(P2, value); }
    int getMode() const { return values_[MODE]; }
    void setMode(int mode) { set(MODE, mode); }

    /** What save() and load() call it. */
    cv::String getDefaultName() const override { return "StereoPhase"; }

    /** Writes the parameters, the preset and the settings, which Python's StereoPhase reads, too. */
    void write(cv::FileStorage &storage) const override {
        storage << "name" << NAME();
        for (int at = 0; at < COUNT; at++) storage << parameter(at).name << values_[at];
        std::string text;
        for (const auto &one : settings_) text += (text.empty() ? "" : "; ") + one.first + "=" + one.second;
        storage << "preset" << preset_ << "settings" << text;
    }

    /** Reads what write, or Python's StereoPhase, has written; what the file lacks stays as it is. */
    void read(const cv::FileNode &node) override {
        if (!node["name"].isString() || static_cast<std::string>(node["name"]) != NAME()) {
            CV_Error(cv::Error::StsParseError, std::string("file: got another object; accepts a ") + NAME());
        }
        int values[COUNT];
        for (int at = 0; at < COUNT; at++) {
            const cv::FileNode found = node[parameter(at).name];
            values[at] = found.empty() ? values_[at] : static_cast<int>(found);
        }
        const std::string preset = node["preset"].empty() ? preset_ : static_cast<std::string>(node["preset"]);
        const Settings settings =
            node["settings"].empty() ? settings_ : split(static_cast<std::string>(node["settings"]));

        const StereoPhase other(values, preset, settings, threads_);  // refuses what is out of range
        for (int at = 0; at < COUNT; at++) values_[at] = values[at];
        preset_ = preset;
        settings_ = settings;
        matcher_.reset();
    }

private:
    enum {
        MIN_DISPARITY, NUM_DISPARITIES, BLOCK_SIZE, P1, P2, DISP12_MAX_DIFF, PRE_FILTER_CAP, UNIQUENESS_RATIO,
        SPECKLE_WINDOW_SIZE, SPECKLE_RANGE, MODE, COUNT
    };

    struct Parameter {
        const char *name;
        int least, most;
    };

    static const char *NAME() { return "StereoMatcher.Phase"; }

    static const Parameter &parameter(int at) {
        constexpr int any = std::numeric_limits<int>::min(), most = std::numeric_limits<int>::max();
        static const Parameter all[COUNT] = {
            {"minDisparity", -LARGEST, LARGEST}, {"numDisparities", 1, 2 * LARGEST + 1}, {"blockSize", 0, 63},
            {"P1", 0, most}, {"P2", 0, most}, {"disp12MaxDiff", any, most}, {"preFilterCap", 0, most},
            {"uniquenessRatio", any, 100}, {"speckleWindowSize", any, most}, {"speckleRange", any, most}, {"mode", 0, 3},
        };
        return all[at];
    }

    /** Reads "median=0; fill=true". */
    static Settings split(const std::string &text) {
        Settings settings;
        std::istringstream parts(text);
        for (std::string part; std::getline(parts, part, ';');) {
            const std::size_t sign = part.find('='), start = part.find_first_not_of(' ');
            if (sign != std::string::npos) settings[part.substr(start, sign - start)] = part.substr(sign + 1);
        }
        return settings;
    }

    StereoPhase(const int (&values)[COUNT], const std::string &preset, const Settings &settings, int threads)
        : preset_(preset), settings_(settings), threads_(threads) {
        for (int at = 0; at < COUNT; at++) set(at, values[at]);
        for (const char *name : {"window", "lr_check", "uniqueness", "speckle_size", "speckle_range"}) {
            if (settings.count(name)) CV_Error(cv::Error::StsBadArg, std::string(name) + ": a parameter of OpenCV sets it here");
        }
        checkRange();
        current();  // what is wrong with the settings is said here, and not by the first pair
    }

    void set(int at, int value) {
        const Parameter &one = parameter(at);
        if (value < one.least || value > one.most) {
            CV_Error(cv::Error::StsOutOfRange, std::string(one.name) + ": got " + std::to_string(value) + "; accepts " +
                                                   std::to_string(one.least) + " to " + std::to_string(one.most));
        }
        values_[at] = value;
        matcher_.reset();
    }

    /** Refuses disparities of which int16 holds no sixteenths. */
    void checkRange() const {
        if (values_[NUM_DISPARITIES] > LARGEST + 1 - values_[MIN_DISPARITY]) {
            CV_Error(cv::Error::StsOutOfRange,
                     "numDisparities: got " + std::to_string(values_[NUM_DISPARITIES]) + "; accepts 1 to " +
                         std::to_string(LARGEST + 1 - values_[MIN_DISPARITY]) + ", of which int16 holds sixteenths");
        }
    }

    void checkPair(const cv::Mat &left, const cv::Mat &right) const {
        checkRange();
        if (left.size() != right.size() || left.type() != right.type()) {
            CV_Error(cv::Error::StsUnmatchedSizes, "right: got another size or type; accepts those of left");
        }
        const bool known = left.channels() == 1 || left.channels() == 3 || left.channels() == 4;
        if (left.empty() || left.dims != 2 || !known || (left.depth() != CV_8U && left.depth() != CV_16U)) {
            CV_Error(cv::Error::StsUnsupportedFormat, "left: got type " + std::to_string(left.type()) +
                                                          "; accepts CV_8U and CV_16U with 1, 3 (BGR) or 4 channels");
        }
    }

    static phasestereo_image view(const cv::Mat &image) {
        phasestereo_image viewed = phasestereo_image();
        viewed.struct_size = sizeof viewed;
        viewed.data = image.data;
        viewed.stride = static_cast<std::ptrdiff_t>(image.step);
        viewed.width = static_cast<std::uint32_t>(image.cols);
        viewed.height = static_cast<std::uint32_t>(image.rows);
        viewed.channels = image.channels() == 1   ? PHASESTEREO_GRAY
                          : image.channels() == 3 ? PHASESTEREO_BGR
                                                  : PHASESTEREO_BGRA;
        viewed.bits = image.depth() == CV_16U ? 16 : 8;
        return viewed;
    }

    /** The settings that the parameters mean; numbers out of the range of ours mean what cv::StereoSGBM makes of them. */
    Settings meant() const {
        Settings all = {{"fill", "false"}, {"confidence", "false"}};
        for (const auto &one : settings_) all[one.first] = one.second;

        const int block = values_[BLOCK_SIZE], ratio = values_[UNIQUENESS_RATIO];
        const int most = values_[DISP12_MAX_DIFF] > 0 ? values_[DISP12_MAX_DIFF] : 1;
        const bool speckles = values_[SPECKLE_RANGE] >= 0 && values_[SPECKLE_WINDOW_SIZE] > 0;
        if (block > 0) all["window"] = std::to_string(block + 1 - block % 2);
        all["lr_check"] = most < values_[NUM_DISPARITIES] - 1 ? std::to_string(most) : "none";
        all["uniqueness"] = std::to_string(ratio >= 0 ? ratio : 10);
        all["speckle_size"] = std::to_string(speckles ? values_[SPECKLE_WINDOW_SIZE] : 0);
        all["speckle_range"] = std::to_string(speckles ? std::min(values_[SPECKLE_RANGE], 16384) : 0);
        return all;
    }

    /** The matcher of the parameters as they are now. */
    std::shared_ptr<phasestereo_matcher> current() {
        const std::lock_guard<std::mutex> guard(lock_);
        if (!matcher_) {
            const Settings all = meant();
            std::vector<phasestereo_setting> listed;
            for (const auto &one : all) listed.push_back({one.first.c_str(), one.second.c_str()});
            matcher_.reset(phasestereo_new(preset_.c_str(), listed.data(), listed.size(), static_cast<std::uint32_t>(threads_)),
                           phasestereo_free);
            check(matcher_ != nullptr);
            const auto fill = settings_.find("fill");
            fills_ = fill != settings_.end() && (fill->second == "true" || fill->second == "True");
        }
        return matcher_;
    }

    /** Returns a disparity in sixteenths; invalid where smoothing has led it out of the right image. */
    short rounded(float disparity, int x, int width) const {
        const bool none = std::isnan(disparity);
        const float column = none ? 0.0F : static_cast<float>(x) - std::nearbyint(disparity);
        if (none || (!fills_ && (column < 0 || column >= static_cast<float>(width)))) {
            return static_cast<short>((values_[MIN_DISPARITY] - 1) * DISP_SCALE);
        }
        return static_cast<short>(std::nearbyint(disparity * DISP_SCALE));
    }

    static void check(bool went_well) {
        if (!went_well) CV_Error(cv::Error::StsBadArg, phasestereo_error());
    }

    static constexpr int LARGEST = 2047;  // the largest whole disparity whose sixteenths int16 holds

    int values_[COUNT];
    std::string preset_;
    Settings settings_;
    int threads_;
    bool fills_ = false;
    std::mutex lock_;
    std::shared_ptr<phasestereo_matcher> matcher_;
};

}  // namespace phasestereo

#endif  // PHASESTEREO_HPP
