#include "omnimj_ros2_control/link.hpp"

#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <limits>
#include <random>
#include <stdexcept>

namespace omnimj_ros2_control
{
namespace
{

constexpr double answer_timeout = 2.0;        // [s]
constexpr double request_interval = 0.05;     // [s]
constexpr double valid_for = 0.05;            // [s]
constexpr double oldest_telemetry = 0.02;     // [s]
constexpr double acknowledge_timeout = 0.04;  // [s]
constexpr double refusal_window = 1.0;        // [s]: the third transient refusal within it ends the drive
constexpr double keep_alive_interval = 0.25;  // [s]: a device ends a session that is silent for 1 s
constexpr double margin = 0.99;  // of the limits of the device, which refuses and latches what exceeds them
constexpr int most_packets = 256;             // of one call, so that a flood cannot delay the caller

uint64_t random_bits()
{
  static std::random_device source;
  return (static_cast<uint64_t>(source()) << 32) ^ source();
}

std::array<uint8_t, OMJ_KEY_SIZE> read_key(const std::string & file)
{
  struct stat about {};
  if (stat(file.c_str(), &about) != 0) {
    throw std::runtime_error(file + ": no such file");
  }
  if ((about.st_mode & 077) != 0) {
    throw std::runtime_error(file + ": others may read it; set its mode to 0600");
  }
  std::ifstream stream(file);
  std::string digits;
  stream >> digits;
  if (digits.size() != 2 * OMJ_KEY_SIZE || digits.find_first_not_of("0123456789abcdefABCDEF") != std::string::npos) {
    throw std::runtime_error(file + ": 64 hexadecimal digits are needed");
  }
  std::array<uint8_t, OMJ_KEY_SIZE> key{};
  for (size_t k = 0; k < key.size(); k++) {
    key[k] = static_cast<uint8_t>(std::stoi(digits.substr(2 * k, 2), nullptr, 16));
  }
  if (omj_is_weak_key(key.data())) {
    throw std::runtime_error(file + ": the key is not random");
  }
  return key;
}

bool is_transient(uint8_t code)
{
  return code == OMJ_FAULT_STALE || code == OMJ_FAULT_NOT_ARMED || code == OMJ_FAULT_ARM_NOT_ZERO ||
         code == OMJ_FAULT_ARM_STALE_TELEMETRY;
}

}  // namespace

Link::Link(
  const std::string & host, const std::string & port, const std::string & key_file, Calibration calibration)
: calibration_(std::move(calibration)),
  speed_(wheels(), 0.0),
  current_(wheels(), 0.0),
  last_current_(wheels(), 0.0)
{
  if (!key_file.empty()) {
    key_ = read_key(key_file);
    keyed_ = true;
  } else if (host != "127.0.0.1") {
    throw std::runtime_error("beyond 127.0.0.1 a key is needed: parameter key_file");
  }
  addrinfo wanted{}, * found = nullptr;
  wanted.ai_socktype = SOCK_DGRAM;
  if (getaddrinfo(host.c_str(), port.c_str(), &wanted, &found) != 0) {
    throw std::runtime_error("no such address: " + host + ":" + port);
  }
  socket_ = socket(found->ai_family, SOCK_DGRAM, 0);
  const bool connected = socket_ >= 0 && ::connect(socket_, found->ai_addr, found->ai_addrlen) == 0;
  freeaddrinfo(found);
  if (!connected) {
    if (socket_ >= 0) {
      close(socket_);
    }
    throw std::runtime_error("cannot reach " + host + ":" + port);
  }
}

Link::~Link()
{
  stop();
  close(socket_);
}

double Link::now() const
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void Link::send(uint8_t type, omj_frame frame)
{
  frame.type = type;
  frame.session = session_;
  frame.sequence = ++sequence_;
  frame.time_us = static_cast<uint64_t>(1e6 * now());
  uint8_t packet[OMJ_LONGEST_FRAME];
  const uint8_t * key = !keyed_ ? nullptr : session_ ? session_key_.data() : key_.data();
  const size_t size = omj_encode(&frame, key, packet);
  if (size) {
    sent_ = now();
    (void)!::send(socket_, packet, size, MSG_DONTWAIT | MSG_NOSIGNAL);  // lost packets show in telemetry
  }
}

void Link::wait(double longest)
{
  pollfd one{socket_, POLLIN, 0};
  ::poll(&one, 1, static_cast<int>(std::ceil(1e3 * longest)));
}

void Link::connect()
{
  stop();
  session_ = sequence_ = commanded_ = 0;
  has_telemetry_ = armed_ = false;
  hello_ = {random_bits(), 0, 0};
  const double until = now() + answer_timeout;
  double next = 0.0;
  while (!has_telemetry_) {
    if (now() > until) {
      lose("the device does not answer: not connected, another key, or another protocol");
    }
    if (now() >= next) {
      omj_frame frame{};
      if (session_) {
        frame.of.nonce = random_bits();
        send(OMJ_PING, frame);
      } else {
        frame.of.hello = hello_;
        send(OMJ_HELLO, frame);
      }
      next = now() + request_interval;
    }
    wait(0.005);
    poll();
  }
}

void Link::arm()
{
  const double until = now() + answer_timeout;
  double next = 0.0;
  std::fill(last_current_.begin(), last_current_.end(), 0.0);
  refusals_.clear();
  pending_.clear();
  if (!session_) {
    throw std::runtime_error("there is no session");
  }
  while (!armed_) {
    if (now() > until) {
      lose("the device does not report that it is armed");
    }
    const omj_telemetry & seen = newest_.of.telemetry;
    if (seen.fault) {
      lose("the device has latched fault " + std::to_string(seen.fault) + ": look for its cause, then reset it");
    }
    omj_frame frame{};
    if (seen.status & OMJ_STATUS_STOPPED) {
      frame.of.seen = newest_.sequence;
      send(OMJ_RESET, frame);
    } else {
      command(std::vector<double>(wheels(), 0.0));
      if (seen.acknowledged && now() >= next) {
        frame.of.arm = {omj_limits_hash(&capabilities_.limits), calibration_.hash, newest_.sequence};
        asked_to_arm_ = true;
        send(OMJ_ARM, frame);
        next = now() + request_interval;
      }
    }
    wait(1e-6 * capabilities_.period_us);
    poll();
  }
}

void Link::poll()
{
  uint8_t packet[OMJ_LONGEST_FRAME + 1];
  for (int k = 0; k < most_packets; k++) {
    const ssize_t size = recv(socket_, packet, sizeof packet, MSG_DONTWAIT);
    if (size < 0) {
      break;
    }
    take(packet, static_cast<size_t>(size));
  }
  if (!armed_) {
    return;
  }
  if (now() - arrived_ > oldest_telemetry) {
    lose("the newest telemetry is older than 20 ms");
  }
  if (!pending_.empty() && now() - pending_.front().second > acknowledge_timeout) {
    lose("a command has not been acknowledged for 40 ms");
  }
}

void Link::take(const uint8_t * packet, size_t size)
{
  omj_frame frame{};
  const bool outside = size >= 8 && omj_get(packet + 4, 4) == 0;
  std::array<uint8_t, OMJ_KEY_SIZE> key = key_;
  if (keyed_ && !outside) {
    omj_session_key(key.data(), key_.data(), &hello_);
  }
  if (omj_decode(packet, size, keyed_ ? key.data() : nullptr, &frame) != OMJ_RIGHT || (keyed_ && !frame.authentic)) {
    return;
  }
  if (frame.type == OMJ_CHALLENGE && !session_ && frame.of.hello.nonce == hello_.nonce) {
    hello_ = frame.of.hello;
    frame = {};
    frame.of.hello = hello_;
    send(OMJ_HELLO, frame);
  } else if (frame.type == OMJ_CAPABILITIES && frame.of.capabilities.nonce == hello_.nonce) {
    on_capabilities(frame);
  } else if (frame.type == OMJ_FAULT && frame.session == 0 && frame.of.fault.code == OMJ_FAULT_BUSY) {
    if (!session_ && frame.of.fault.sequence == static_cast<uint32_t>(hello_.nonce)) {
      lose("another host has the armed device");
    }
  } else if (session_ && frame.session == session_ && frame.type == OMJ_TELEMETRY) {
    if (!has_telemetry_ || frame.sequence > newest_.sequence) {
      on_telemetry(frame);
    }
  } else if (session_ && frame.session == session_ && frame.type == OMJ_FAULT) {
    on_fault(frame.of.fault);
  }
}

void Link::on_capabilities(const omj_frame & frame)
{
  if (session_) {
    if (frame.session != session_) {
      lose("the device has begun another session: it has restarted");
    }
    return;  // repeated for passive listeners
  }
  if (!frame.session || !frame.same_schema) {
    lose("the device has another layout of messages");
  }
  require_expected(frame.of.capabilities);
  capabilities_ = frame.of.capabilities;
  session_ = frame.session;
  sequence_ = 0;
  if (keyed_) {
    omj_session_key(session_key_.data(), key_.data(), &hello_);
  }
  previous_raw_.assign(capabilities_.channels, std::numeric_limits<double>::quiet_NaN());
  omj_frame ping{};
  ping.of.nonce = random_bits();
  send(OMJ_PING, ping);
}

void Link::require_expected(const omj_capabilities & found) const
{
  const std::string other = "this is not the device of the calibration: ";
  if (found.lock_step) {
    throw std::runtime_error("the device is in lock-step, which is not for ros2_control");
  }
  if (found.wheels != wheels() || found.limits_hash != omj_limits_hash(&found.limits)) {
    throw std::runtime_error(other + "number of wheels or limits");
  }
  if (found.calibration_hash != calibration_.hash) {
    throw std::runtime_error(other + "it was commissioned with another one");
  }
  for (const Input & input : calibration_.inputs) {
    const omj_channel & kind = found.channel[input.channel];
    if (
      input.channel >= found.channels || kind.quantity != input.quantity || kind.wheel != input.wheel ||
      kind.raw != input.raw)
    {
      throw std::runtime_error(other + "channel of " + input.name);
    }
  }
}

void Link::on_telemetry(const omj_frame & frame)
{
  const omj_telemetry & found = frame.of.telemetry;
  if (found.channels != capabilities_.channels) {
    lose("the telemetry has other channels than the capabilities");
  }
  if (found.acknowledged > commanded_) {
    lose("the device acknowledges a command that was not sent");
  }
  const double elapsed =
    has_telemetry_ ? 1e-6 * (static_cast<double>(frame.time_us) - static_cast<double>(newest_.time_us)) : 0.0;
  newest_ = frame;
  arrived_ = now();
  has_telemetry_ = true;
  convert(elapsed);
  while (!pending_.empty() && pending_.front().first <= found.acknowledged) {
    pending_.pop_front();
  }
  const bool reports = (found.status & OMJ_STATUS_ARMED) != 0;
  if (armed_ && !reports) {
    lose("the device is no longer armed, fault " + std::to_string(found.fault));
  }
  if (reports && !asked_to_arm_) {
    lose("the device is armed without a request");
  }
  armed_ = reports;
}

// Readings in SI units; one that is not finite keeps the value before, and the device judges it.
void Link::convert(double elapsed)
{
  for (const Input & input : calibration_.inputs) {
    if (!input.wheel) {
      continue;
    }
    const omj_reading & reading = newest_.of.telemetry.raw[input.channel];
    const double raw = input.raw == OMJ_RAW_COUNTS ? reading.counts : reading.volts;
    const double before = previous_raw_[input.channel];
    if (!std::isfinite(raw)) {
      continue;
    }
    double value = input.factor * (raw - input.offset);
    if (input.quantity == OMJ_QUANTITY_WHEEL_ANGLE) {
      previous_raw_[input.channel] = raw;
      if (!std::isfinite(before) || elapsed <= 0.0) {
        continue;
      }
      double turned = raw - before;
      turned -= input.wrap > 0.0 ? input.wrap * std::round(turned / input.wrap) : 0.0;
      value = input.factor * turned / elapsed;
    }
    double & to = input.quantity == OMJ_QUANTITY_CURRENT ? current_[input.wheel - 1] : speed_[input.wheel - 1];
    const double share = input.filter > 0.0 ? 1.0 - std::exp(-std::max(elapsed, 0.0) / input.filter) : 1.0;
    to += share * (value - to);
  }
}

void Link::on_fault(const omj_fault & fault)
{
  if (!asked_to_arm_) {
    return;
  }
  if (is_transient(fault.code) && !fault.latched) {
    refusals_.push_back(now());
    while (!refusals_.empty() && now() - refusals_.front() > refusal_window) {
      refusals_.pop_front();
    }
    if (refusals_.size() < 3) {
      return;
    }
  }
  lose("the device reports fault " + std::to_string(fault.code) + " of wheel " + std::to_string(fault.wheel));
}

void Link::command(const std::vector<double> & currents)
{
  const omj_limits & limits = capabilities_.limits;
  const double period = 1e-6 * capabilities_.period_us;
  omj_frame frame{};
  omj_command & to = frame.of.command;
  to.valid_for = std::min(static_cast<float>(valid_for), limits.valid_for);
  to.wheels = static_cast<uint8_t>(wheels());
  to.telemetry = newest_.sequence;
  for (size_t k = 0; k < wheels(); k++) {
    const Output & output = calibration_.outputs[k];
    // a controller that has nothing to say leaves NaN in its commands
    const double wanted = std::isfinite(currents[k]) ? output.factor * currents[k] : 0.0;
    const double most = margin * limits.current, step = margin * limits.current_rate * period;
    double sent = std::clamp(wanted, -most, most);
    sent = std::clamp(sent, last_current_[k] - step, last_current_[k] + step);
    last_current_[k] = sent;
    to.current[output.channel] = static_cast<float>(sent);
  }
  send(OMJ_COMMAND, frame);
  commanded_ = sequence_;
  if (armed_) {
    pending_.emplace_back(sequence_, now());
  }
}

void Link::keep_alive()
{
  if (session_ && now() - sent_ > keep_alive_interval) {
    omj_frame frame{};
    frame.of.nonce = random_bits();
    send(OMJ_PING, frame);
  }
}

void Link::stop() noexcept
{
  if (asked_to_arm_) {
    for (int k = 0; k < 3; k++) {
      send(OMJ_STOP);
    }
  }
  asked_to_arm_ = armed_ = false;
  pending_.clear();
}

void Link::lose(const std::string & reason)
{
  stop();
  throw std::runtime_error(reason);
}

}  // namespace omnimj_ros2_control
