// The part of ROS 2's header that the example uses, with the same names and types.
#pragma once
#include <string>
namespace hardware_interface
{
class Handle
{
public:
  Handle(const std::string & joint, const std::string & interface, double * value)
  : joint_(joint), interface_(interface), value_(value) {}
  std::string get_name() const {return joint_ + "/" + interface_;}
  double get_value() const {return *value_;}
  void set_value(double value) {*value_ = value;}

private:
  std::string joint_, interface_;
  double * value_;
};
class StateInterface : public Handle
{
public:
  using Handle::Handle;
};
class CommandInterface : public Handle
{
public:
  using Handle::Handle;
};
}  // namespace hardware_interface
