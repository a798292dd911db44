"""The rclpy nodes; the only place that imports rclpy."""
