#include "omnimj_ros2_control/calibration.hpp"

#include <array>
#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "omnimj_link.h"

namespace omnimj_ros2_control
{
namespace
{

const std::array<const char *, OMJ_QUANTITIES> quantities = {
  "current", "wheel_speed", "wheel_angle", "acceleration_x", "acceleration_y",
  "yaw_rate", "yaw", "supply", "other"};

uint8_t quantity_of(const std::string & word)
{
  for (size_t k = 0; k < quantities.size(); k++) {
    if (word == quantities[k]) {
      return static_cast<uint8_t>(k);
    }
  }
  throw std::runtime_error("unknown quantity '" + word + "'");
}

// Number of the wheel at the end of a name, wheel_speed_2; 0 for quantities of the body.
uint8_t wheel_of(const std::string & name, uint8_t quantity)
{
  if (quantity > OMJ_QUANTITY_WHEEL_ANGLE) {
    return 0;
  }
  const int number = std::stoi(name.substr(name.rfind('_') + 1));
  if (number < 1 || number > static_cast<int>(OMJ_MOST_WHEELS)) {
    throw std::runtime_error("'" + name + "' is of no wheel");
  }
  return static_cast<uint8_t>(number);
}

Input read_input(std::istringstream & words)
{
  Input found{};
  std::string quantity, raw;
  int channel = -1, sign = 0;
  double gain = 0.0;
  words >> found.name >> quantity >> raw >> channel >> sign >> gain >> found.offset >> found.filter >>
    found.wrap;
  if (!words || channel < 0 || channel >= static_cast<int>(OMJ_MOST_CHANNELS)) {
    throw std::runtime_error("an input is not whole");
  }
  found.quantity = quantity_of(quantity);
  found.wheel = wheel_of(found.name, found.quantity);
  found.raw = raw == "counts" ? OMJ_RAW_COUNTS : OMJ_RAW_VOLTS;
  found.channel = static_cast<uint8_t>(channel);
  found.factor = sign * gain;
  return found;
}

Output read_output(std::istringstream & words, size_t before)
{
  size_t wheel = 0;
  int channel = -1, sign = 0;
  double gain = 0.0;
  std::string unit;
  words >> wheel >> channel >> sign >> gain >> unit;
  if (!words || wheel != before + 1 || (sign != 1 && sign != -1)) {
    throw std::runtime_error("an output is not whole, or out of order");
  }
  if (unit == "V/A") {  // an analog box takes amperes in the order of the wheels
    return {static_cast<uint8_t>(before), static_cast<double>(sign)};
  }
  if (channel < 0 || channel >= static_cast<int>(OMJ_MOST_WHEELS) || gain == 0.0) {
    throw std::runtime_error("an output has no channel or no gain");
  }
  return {static_cast<uint8_t>(channel), sign * gain};
}

}  // namespace

Calibration Calibration::read(const std::string & file)
{
  std::ifstream stream(file, std::ios::binary);
  if (!stream) {
    throw std::runtime_error(file + ": no such file");
  }
  std::stringstream content;
  content << stream.rdbuf();
  const std::string text = content.str();
  Calibration found{};
  found.hash = omj_short_hash(reinterpret_cast<const uint8_t *>(text.data()), text.size());
  std::istringstream lines(text);
  std::string line, word;
  std::getline(lines, line);
  try {
    if (line != "omnimj calibration 1") {
      throw std::runtime_error("it does not begin with 'omnimj calibration 1'");
    }
    while (std::getline(lines, line)) {
      std::istringstream words(line);
      words >> word;
      if (word == "input") {
        found.inputs.push_back(read_input(words));
      } else if (word == "output") {
        found.outputs.push_back(read_output(words, found.outputs.size()));
      } else {
        throw std::runtime_error("unknown word '" + word + "'");
      }
    }
    if (found.outputs.empty() || found.outputs.size() > OMJ_MOST_WHEELS) {
      throw std::runtime_error("1 to 8 outputs are needed");
    }
  } catch (const std::exception & error) {
    throw std::runtime_error(file + ": " + error.what());
  }
  return found;
}

}  // namespace omnimj_ros2_control
