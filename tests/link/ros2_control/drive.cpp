// What a controller manager does with the hardware, for a test: PORT CALIBRATION KEY_FILE EFFORT CYCLES [kill].
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "omnimj_ros2_control/system.hpp"

using omnimj_ros2_control::System;
using hardware_interface::CallbackReturn;
using hardware_interface::return_type;

int main(int, char ** argv)
{
  hardware_interface::HardwareInfo info;
  info.hardware_parameters = {
    {"host", "127.0.0.1"}, {"port", argv[1]}, {"calibration", argv[2]}, {"key_file", argv[3]}};
  for (int k = 1; k <= 4; k++) {
    info.joints.push_back(
      {"wheel_" + std::to_string(k), {{"effort"}}, {{"velocity"}}, {{"torque_constant", "0.5"}}});
  }
  System system;
  const rclcpp_lifecycle::State state;
  if (system.on_init(info) != CallbackReturn::SUCCESS || system.on_configure(state) != CallbackReturn::SUCCESS) {
    return 3;
  }
  auto states = system.export_state_interfaces();
  auto commands = system.export_command_interfaces();
  for (int k = 0; k < 200; k++) {  // inactive hardware is read, too
    system.read({}, {});
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  if (system.on_activate(state) != CallbackReturn::SUCCESS) {
    return 4;
  }
  const int cycles = std::atoi(argv[5]);
  for (int k = 0; k < cycles; k++) {
    if (system.read({}, {}) != return_type::OK) {
      return 5;
    }
    for (auto & one : commands) {
      one.set_value(std::atof(argv[4]));
    }
    if (system.write({}, {}) != return_type::OK) {
      return 6;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  for (auto & one : states) {
    std::printf("%s %.9g\n", one.get_name().c_str(), one.get_value());
  }
  std::fflush(stdout);
  if (argv[6]) {
    std::_Exit(0);  // without a stop, as if it had been killed
  }
  system.on_deactivate(state);
  system.on_cleanup(state);
  return 0;
}
