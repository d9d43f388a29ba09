// The part of ROS 2's header that the example uses, with the same names and types.
#pragma once
#include <string>
#include <unordered_map>
#include <vector>
namespace hardware_interface
{
struct InterfaceInfo
{
  std::string name;
};
struct ComponentInfo
{
  std::string name;
  std::vector<InterfaceInfo> command_interfaces, state_interfaces;
  std::unordered_map<std::string, std::string> parameters;
};
struct HardwareInfo
{
  std::string name;
  std::unordered_map<std::string, std::string> hardware_parameters;
  std::vector<ComponentInfo> joints;
};
}  // namespace hardware_interface
