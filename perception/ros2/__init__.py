"""Messages of ROS 2 cameras without ROS: encoding, images, lenses, transforms. Imports no other room."""
