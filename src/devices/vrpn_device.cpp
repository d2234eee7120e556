// see open_device.h
