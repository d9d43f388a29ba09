// The part of ROS 2's header that the example uses, with the same names and types.
#pragma once
namespace rclcpp_lifecycle
{
class State
{
};
}  // namespace rclcpp_lifecycle
