// Hardware of ros2_control: the wheels of a robot behind the link of omnimj.
#pragma once

#include <memory>
#include <vector>

#include "hardware_interface/handle.hpp"
#include "hardware_interface/hardware_info.hpp"
#include "hardware_interface/system_interface.hpp"
#include "hardware_interface/types/hardware_interface_return_values.hpp"
#include "omnimj_ros2_control/link.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace omnimj_ros2_control
{

class System : public hardware_interface::SystemInterface
{
public:
  using CallbackReturn = hardware_interface::CallbackReturn;

  CallbackReturn on_init(const hardware_interface::HardwareInfo & info) override;
  std::vector<hardware_interface::StateInterface> export_state_interfaces() override;
  std::vector<hardware_interface::CommandInterface> export_command_interfaces() override;
  CallbackReturn on_configure(const rclcpp_lifecycle::State & previous) override;
  CallbackReturn on_cleanup(const rclcpp_lifecycle::State & previous) override;
  CallbackReturn on_shutdown(const rclcpp_lifecycle::State & previous) override;
  CallbackReturn on_activate(const rclcpp_lifecycle::State & previous) override;
  CallbackReturn on_deactivate(const rclcpp_lifecycle::State & previous) override;
  CallbackReturn on_error(const rclcpp_lifecycle::State & previous) override;
  hardware_interface::return_type read(const rclcpp::Time & time, const rclcpp::Duration & period) override;
  hardware_interface::return_type write(const rclcpp::Time & time, const rclcpp::Duration & period) override;

private:
  struct Joint
  {
    double torque_constant;  // [Nm/A] at the wheel; 1 where the commands are currents
    double command, position, velocity, effort;
  };
  CallbackReturn end(CallbackReturn result);
  CallbackReturn fail(const std::exception & error);

  std::vector<Joint> joints_;  // wheel 1, 2, …, in the order of the URDF
  std::unique_ptr<Link> link_;
  bool active_ = false;
  double last_time_ = 0.0;  // of the device's clock [s]
};

}  // namespace omnimj_ros2_control
