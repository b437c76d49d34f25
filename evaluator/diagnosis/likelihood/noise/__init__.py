"""What no model of the robot explains: tracking noise, its drift, outliers, and motion on open ground."""
