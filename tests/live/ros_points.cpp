// Points that ROS 1's own consumers make of our messages, given as serialized files.
//
// ros_points DEPTH CAMERA_INFO LEFT_INFO RIGHT_INFO DISPARITY LEFT_IMAGE OF_DEPTH OF_DISPARITY
//
// OF_DEPTH gets x, y, z of each pixel by depth_image_proc, OF_DISPARITY by stereo_image_proc.

#include <boost/make_shared.hpp>
#include <depth_image_proc/depth_conversions.h>
#include <fstream>
#include <iterator>
#include <ros/serialization.h>
#include <stereo_image_proc/processor.h>
#include <vector>

template <class Message>
Message read(const char* path)
{
    std::ifstream file(path, std::ios::binary);
    std::vector<uint8_t> data((std::istreambuf_iterator<char>(file)), {});
    ros::serialization::IStream stream(data.data(), data.size());
    Message message;
    ros::serialization::deserialize(stream, message);
    return message;
}

void write(const char* path, const sensor_msgs::PointCloud2& cloud)
{
    std::ofstream file(path, std::ios::binary);
    sensor_msgs::PointCloud2ConstIterator<float> point(cloud, "x");
    for (size_t left = cloud.width * cloud.height; left > 0; --left, ++point)
        file.write(reinterpret_cast<const char*>(&point[0]), 3 * sizeof(float));
}

int main(int, char** paths)
{
    auto depth = boost::make_shared<sensor_msgs::Image>(read<sensor_msgs::Image>(paths[1]));
    image_geometry::PinholeCameraModel camera;
    camera.fromCameraInfo(read<sensor_msgs::CameraInfo>(paths[2]));
    auto of_depth = boost::make_shared<sensor_msgs::PointCloud2>();
    of_depth->height = depth->height;
    of_depth->width = depth->width;
    sensor_msgs::PointCloud2Modifier(*of_depth).setPointCloud2FieldsByString(1, "xyz");
    if (depth->encoding == "16UC1")
        depth_image_proc::convert<uint16_t>(depth, of_depth, camera);
    else
        depth_image_proc::convert<float>(depth, of_depth, camera);
    write(paths[7], *of_depth);

    image_geometry::StereoCameraModel pair;
    pair.fromCameraInfo(
        read<sensor_msgs::CameraInfo>(paths[3]), read<sensor_msgs::CameraInfo>(paths[4]));
    auto image = read<sensor_msgs::Image>(paths[6]);
    cv::Mat color(image.height, image.width, CV_8UC3, image.data.data(), image.step);
    sensor_msgs::PointCloud2 of_disparity;
    stereo_image_proc::StereoProcessor().processPoints2(
        read<stereo_msgs::DisparityImage>(paths[5]), color, "bgr8", pair, of_disparity);
    write(paths[8], of_disparity);
}
