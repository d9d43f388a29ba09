// The part of ROS 2's header that the example uses, with the same names and types.
#pragma once
#include <cstdint>
#include <cstdio>
#include <string>
namespace rclcpp
{
struct Time
{
  int64_t nanoseconds = 0;
};
struct Duration
{
  int64_t nanoseconds = 0;
};
struct Logger
{
  std::string name;
};
inline Logger get_logger(const std::string & name) {return {name};}
}  // namespace rclcpp
#define RCLCPP_ERROR(logger, ...) \
  (std::fprintf(stderr, "[%s] ", (logger).name.c_str()), std::fprintf(stderr, __VA_ARGS__), std::fputc('\n', stderr))
