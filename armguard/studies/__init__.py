"""What armguard costs, buys and withstands, measured by commands that anybody can run again."""
