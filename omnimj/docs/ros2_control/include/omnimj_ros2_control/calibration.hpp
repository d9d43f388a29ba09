// Calibration of a device: the text whose hash host and device compare (PROTOCOL.md, section 3).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace omnimj_ros2_control
{

struct Input
{
  std::string name;  // such as wheel_speed_1
  uint8_t quantity, wheel, raw, channel;
  double factor, offset;  // value = factor (raw − offset); of an angle, the speed is factor × change / time
  double filter;          // time constant of a low-pass filter [s]; 0: none
  double wrap;            // of a counter that starts over; 0: none
};

struct Output
{
  uint8_t channel;  // index of the current in a COMMAND
  double factor;    // current at the device per ampere of the wheel
};

struct Calibration
{
  uint64_t hash;
  std::vector<Input> inputs;
  std::vector<Output> outputs;  // by wheel

  // Throws std::runtime_error if the file is missing or breaks a rule.
  static Calibration read(const std::string & file);
};

}  // namespace omnimj_ros2_control
