// A chainable controller of ros2_control around an exported loop: a template.
//
// It was not compiled: take it as a start. Export the loop, put its header and source beside this
// file, and adapt the names. With two encoders (a cart's position and its pole's angle) as state
// interfaces and one force as a command interface:
//
//   ./dev export cart_pole --out src/my_controller/loop

#include <cmath>
#include <string>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"
#include "loop/cart_pole.h"
#include "pluginlib/class_list_macros.hpp"

namespace my_controller
{
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;

class ExportedController : public controller_interface::ChainableControllerInterface
{
public:
  CallbackReturn on_init() override { return CallbackReturn::SUCCESS; }

  InterfaceConfiguration command_interface_configuration() const override
  {
    return {interface_configuration_type::INDIVIDUAL, {"slider/effort"}};
  }

  InterfaceConfiguration state_interface_configuration() const override
  {
    return {interface_configuration_type::INDIVIDUAL, {"slider/position", "pivot/position"}};
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {
    cart_pole_init(&loop_);
    reference_interfaces_.assign(1, 0.0);
    return CallbackReturn::SUCCESS;
  }

  return_type update_and_write_commands(
    const rclcpp::Time &, const rclcpp::Duration & period) override
  {
    double state[CART_POLE_STATES] = {};
    double force[CART_POLE_INPUTS] = {};
    const double reading[] = {
      state_interfaces_[0].get_value(), state_interfaces_[1].get_value()};
    state[CART_POLE_X_x] = reference_interfaces_[0];
    // a set point that no input holds, or that is not finite, changes nothing
    (void)cart_pole_hold(&loop_, state);
    (void)cart_pole_predict(&loop_, period.seconds());
    (void)cart_pole_correct_joint_states(&loop_, reading, nullptr);
    (void)cart_pole_control(&loop_, period.seconds(), force);
    command_interfaces_[0].set_value(force[0]);
    return return_type::OK;
  }

protected:
  // a controller before this one in the chain, or a topic, writes where the cart shall be
  std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override
  {
    reference_interfaces_.resize(1, 0.0);
    std::vector<hardware_interface::CommandInterface> exported;
    exported.emplace_back(get_node()->get_name(), "x", &reference_interfaces_[0]);
    return exported;
  }

  return_type update_reference_from_subscribers(
    const rclcpp::Time &, const rclcpp::Duration &) override
  {
    return return_type::OK;
  }

private:
  cart_pole_loop loop_{};
};
}  // namespace my_controller

PLUGINLIB_EXPORT_CLASS(
  my_controller::ExportedController, controller_interface::ChainableControllerInterface)
