// The proxy over the capture: its edges, those in front alone.
import * as pc from 'playcanvas';

// data: count of vertices, their places, the triangles' corners; gives what shows and hides it
export function createMesh(app, data) {
    const count = new DataView(data).getUint32(0, true);
    const mesh = new pc.Mesh(app.graphicsDevice);
    mesh.setPositions(new Float32Array(data, 4, 3 * count));
    mesh.setIndices(new Uint32Array(data, 4 + 12 * count));
    mesh.update(pc.PRIMITIVE_TRIANGLES);

    const front = new pc.StandardMaterial();  // gives depth alone
    Object.assign(front, { redWrite: false, greenWrite: false, blueWrite: false, alphaWrite: false, cull: pc.CULLFACE_NONE, depthBias: 1, slopeDepthBias: 1 });
    const lines = new pc.StandardMaterial();
    Object.assign(lines, {
        useLighting: false, useFog: false, useTonemap: false, emissive: new pc.Color(0.35, 0.75, 1), opacity: 0.3,
        blendType: pc.BLEND_NORMAL, depthWrite: false, cull: pc.CULLFACE_NONE
    });
    const instances = [front, lines].map((material, order) => {
        material.update();
        const instance = new pc.MeshInstance(mesh, material, new pc.GraphNode());
        instance.castShadow = false;
        instance.cull = false;
        instance.drawOrder = order;
        return instance;
    });
    instances[1].renderStyle = pc.RENDERSTYLE_WIREFRAME;
    const over = app.scene.layers.getLayerById(pc.LAYERID_IMMEDIATE);
    return (shown) => {
        if (shown) over.addMeshInstances(instances);
        else over.removeMeshInstances(instances);
    };
}
