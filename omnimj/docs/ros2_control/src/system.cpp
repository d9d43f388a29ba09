#include "omnimj_ros2_control/system.hpp"

#include <limits>
#include <stdexcept>
#include <string>

#include "pluginlib/class_list_macros.hpp"

namespace omnimj_ros2_control
{
namespace
{

constexpr double nothing = std::numeric_limits<double>::quiet_NaN();

std::string parameter(
  const hardware_interface::HardwareInfo & info, const std::string & name, const std::string & otherwise = "")
{
  const auto found = info.hardware_parameters.find(name);
  return found == info.hardware_parameters.end() ? otherwise : found->second;
}

rclcpp::Logger logger() {return rclcpp::get_logger("omnimj_ros2_control");}

}  // namespace

System::CallbackReturn System::on_init(const hardware_interface::HardwareInfo & info)
{
  if (hardware_interface::SystemInterface::on_init(info) != CallbackReturn::SUCCESS) {
    return CallbackReturn::ERROR;
  }
  try {
    for (const auto & joint : info_.joints) {
      if (joint.command_interfaces.size() != 1) {
        throw std::runtime_error("joint " + joint.name + " needs one command interface, effort or current");
      }
      const std::string & kind = joint.command_interfaces[0].name;
      const auto constant = joint.parameters.find("torque_constant");
      if (kind == "effort" && constant == joint.parameters.end()) {
        throw std::runtime_error("joint " + joint.name + " needs the parameter torque_constant [Nm/A]");
      }
      if (kind != "effort" && kind != "current") {
        throw std::runtime_error("joint " + joint.name + " takes no " + kind + ", but effort or current");
      }
      const double value = kind == "effort" ? std::stod(constant->second) : 1.0;
      if (!(value > 0.0)) {
        throw std::runtime_error("joint " + joint.name + ": torque_constant must be above 0");
      }
      joints_.push_back({value, 0.0, nothing, nothing, nothing});
    }
  } catch (const std::exception & error) {
    return fail(error);
  }
  return CallbackReturn::SUCCESS;
}

std::vector<hardware_interface::StateInterface> System::export_state_interfaces()
{
  std::vector<hardware_interface::StateInterface> found;
  for (size_t k = 0; k < joints_.size(); k++) {
    const std::string & name = info_.joints[k].name;
    found.emplace_back(name, "position", &joints_[k].position);
    found.emplace_back(name, "velocity", &joints_[k].velocity);
    found.emplace_back(name, info_.joints[k].command_interfaces[0].name, &joints_[k].effort);
  }
  return found;
}

std::vector<hardware_interface::CommandInterface> System::export_command_interfaces()
{
  std::vector<hardware_interface::CommandInterface> found;
  for (size_t k = 0; k < joints_.size(); k++) {
    const auto & joint = info_.joints[k];
    found.emplace_back(joint.name, joint.command_interfaces[0].name, &joints_[k].command);
  }
  return found;
}

System::CallbackReturn System::on_configure(const rclcpp_lifecycle::State &)
{
  try {
    link_ = std::make_unique<Link>(
      parameter(info_, "host", "127.0.0.1"), parameter(info_, "port", "5005"), parameter(info_, "key_file"),
      Calibration::read(parameter(info_, "calibration")));
    if (link_->wheels() != joints_.size()) {
      throw std::runtime_error("the calibration and the URDF have different numbers of wheels");
    }
    link_->connect();
  } catch (const std::exception & error) {
    link_.reset();
    return fail(error);
  }
  return CallbackReturn::SUCCESS;
}

System::CallbackReturn System::on_activate(const rclcpp_lifecycle::State &)
{
  if (!link_) {
    return CallbackReturn::ERROR;
  }
  for (Joint & joint : joints_) {
    joint.command = joint.position = joint.velocity = joint.effort = 0.0;
  }
  try {
    link_->arm();
  } catch (const std::exception & error) {
    return fail(error);
  }
  last_time_ = link_->time();
  active_ = true;
  return CallbackReturn::SUCCESS;
}

System::CallbackReturn System::on_deactivate(const rclcpp_lifecycle::State &)
{
  active_ = false;
  if (link_) {
    link_->stop();
  }
  return CallbackReturn::SUCCESS;
}

System::CallbackReturn System::end(CallbackReturn result)
{
  active_ = false;
  link_.reset();  // stops the device
  return result;
}

System::CallbackReturn System::on_cleanup(const rclcpp_lifecycle::State &) {return end(CallbackReturn::SUCCESS);}
System::CallbackReturn System::on_shutdown(const rclcpp_lifecycle::State &) {return end(CallbackReturn::SUCCESS);}
System::CallbackReturn System::on_error(const rclcpp_lifecycle::State &) {return end(CallbackReturn::SUCCESS);}

System::CallbackReturn System::fail(const std::exception & error)
{
  active_ = false;
  RCLCPP_ERROR(logger(), "%s", error.what());
  return CallbackReturn::ERROR;
}

hardware_interface::return_type System::read(const rclcpp::Time &, const rclcpp::Duration &)
{
  if (!link_) {
    return hardware_interface::return_type::OK;
  }
  try {
    link_->poll();
    link_->keep_alive();
  } catch (const std::exception & error) {
    fail(error);
    return hardware_interface::return_type::ERROR;
  }
  const double elapsed = link_->time() - last_time_;
  last_time_ = link_->time();
  for (size_t k = 0; k < joints_.size(); k++) {
    joints_[k].velocity = link_->speed(k);
    joints_[k].position += active_ ? elapsed * link_->speed(k) : 0.0;
    joints_[k].effort = joints_[k].torque_constant * link_->current(k);
  }
  return hardware_interface::return_type::OK;
}

hardware_interface::return_type System::write(const rclcpp::Time &, const rclcpp::Duration &)
{
  if (!active_) {
    return hardware_interface::return_type::OK;
  }
  std::vector<double> currents;
  for (const Joint & joint : joints_) {
    currents.push_back(joint.command / joint.torque_constant);
  }
  try {
    link_->command(currents);
  } catch (const std::exception & error) {
    fail(error);
    return hardware_interface::return_type::ERROR;
  }
  return hardware_interface::return_type::OK;
}

}  // namespace omnimj_ros2_control

PLUGINLIB_EXPORT_CLASS(omnimj_ros2_control::System, hardware_interface::SystemInterface)
