"""Sub-pixel fit of a mark: disc model, blur, shading, occlusion."""
