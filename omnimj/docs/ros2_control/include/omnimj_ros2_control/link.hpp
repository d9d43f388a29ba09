// Host of the link over UDP, in real time (PROTOCOL.md, section 6).
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "omnimj_link.h"
#include "omnimj_ros2_control/calibration.hpp"

namespace omnimj_ros2_control
{

// All methods but `stop` throw std::runtime_error when the link is lost; the device has then been stopped.
class Link
{
public:
  // Opens the socket and sends nothing. `key_file` may be empty on 127.0.0.1 only.
  Link(const std::string & host, const std::string & port, const std::string & key_file, Calibration calibration);
  ~Link();  // stops the device
  Link(const Link &) = delete;
  Link & operator=(const Link &) = delete;

  // Begins a session and waits for telemetry, for at most 2 s.
  void connect();
  // Resets a latched stop (never a latched fault), sends zero commands and arms, for at most 2 s.
  void arm();
  // Takes all packets that have arrived and applies the host's time limits.
  void poll();
  // Sends the currents of the wheels [A], kept within the device's limits of current and of its rate.
  void command(const std::vector<double> & currents);
  // Keeps the session while nothing is commanded.
  void keep_alive();
  // Stops the device, if this host has armed it: zero current at once, until it is armed again.
  void stop() noexcept;

  size_t wheels() const {return calibration_.outputs.size();}
  double speed(size_t wheel) const {return speed_[wheel];}      // [rad/s]
  double current(size_t wheel) const {return current_[wheel];}  // measured [A]
  double time() const {return 1e-6 * static_cast<double>(newest_.time_us);}  // of the device's clock [s]

private:
  double now() const;
  void send(uint8_t type, omj_frame frame = {});
  void take(const uint8_t * packet, size_t size);
  void on_capabilities(const omj_frame & frame);
  void on_telemetry(const omj_frame & frame);
  void on_fault(const omj_fault & fault);
  void require_expected(const omj_capabilities & found) const;
  void convert(double elapsed);
  void wait(double longest);
  [[noreturn]] void lose(const std::string & reason);

  Calibration calibration_;
  int socket_ = -1;
  bool keyed_ = false, armed_ = false, asked_to_arm_ = false, has_telemetry_ = false;
  std::array<uint8_t, OMJ_KEY_SIZE> key_{}, session_key_{};
  omj_hello hello_{};
  omj_capabilities capabilities_{};
  uint32_t session_ = 0, sequence_ = 0, commanded_ = 0;
  omj_frame newest_{};  // telemetry
  double arrived_ = 0.0, sent_ = 0.0, commanded_at_ = 0.0;
  std::deque<double> refusals_;
  std::deque<std::pair<uint32_t, double>> pending_;  // commands that no telemetry has acknowledged
  std::vector<double> speed_, current_, last_current_, previous_raw_;
};

}  // namespace omnimj_ros2_control
