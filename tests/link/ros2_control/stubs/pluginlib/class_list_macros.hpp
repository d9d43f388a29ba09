// The part of ROS 2's header that the example uses: the class must be a complete one of its base.
#pragma once
#include <type_traits>
#define PLUGINLIB_EXPORT_CLASS(type, base) \
  static_assert(std::is_base_of<base, type>::value && !std::is_abstract<type>::value, "no plugin");
