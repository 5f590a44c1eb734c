// A program of OpenCV's StereoSGBM, as there are many: stereo_match LEFT RIGHT DISPARITY.tiff NUM_DISPARITIES.
// tests/core/test_cpp.py compiles it as it is, and with the line that makes the matcher exchanged.

#include <cstdio>
#include <cstdlib>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#if CV_VERSION_MAJOR >= 5
#include <opencv2/stereo.hpp>
#else
#include <opencv2/calib3d.hpp>
#endif

using namespace cv;

int main(int argc, char **argv) {
    if (argc != 5) return 2;
    const Mat img1 = imread(argv[1], IMREAD_COLOR), img2 = imread(argv[2], IMREAD_COLOR);
    if (img1.empty() || img2.empty()) return 2;

    Ptr<StereoSGBM> sgbm = StereoSGBM::create(0, 16, 3);
    const int sgbmWinSize = 5, cn = img1.channels();
    sgbm->setPreFilterCap(63);
    sgbm->setBlockSize(sgbmWinSize);
    sgbm->setP1(8 * cn * sgbmWinSize * sgbmWinSize);
    sgbm->setP2(32 * cn * sgbmWinSize * sgbmWinSize);
    sgbm->setMinDisparity(0);
    sgbm->setNumDisparities(std::atoi(argv[4]));
    sgbm->setUniquenessRatio(10);
    sgbm->setSpeckleWindowSize(100);
    sgbm->setSpeckleRange(32);
    sgbm->setDisp12MaxDiff(1);
    sgbm->setMode(StereoSGBM::MODE_SGBM);

    Mat disp;
    sgbm->compute(img1, img2, disp);
    std::printf("type %d, %d disparities\n", disp.type() == CV_16S, sgbm->getNumDisparities());
    Mat pixels;
    disp.convertTo(pixels, CV_32F, 1.0 / StereoMatcher::DISP_SCALE);
    return imwrite(argv[3], pixels) ? 0 : 1;
}
