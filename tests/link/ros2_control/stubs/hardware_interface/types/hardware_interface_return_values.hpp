// The part of ROS 2's header that the example uses, with the same names and types.
#pragma once
#include <cstdint>
namespace hardware_interface
{
enum class return_type : std::uint8_t { OK = 0, ERROR = 1, DEACTIVATE = 2 };
}  // namespace hardware_interface
